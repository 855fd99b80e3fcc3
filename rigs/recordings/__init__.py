"""The images that cameras wrote, stills and films, read as stored: linear, row 0 first."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "films": [
            "CONTAINER_SUFFIXES",
            "FILM_FORMATS",
            "FILM_SUFFIXES",
            "is_film",
            "open_recording",
            "split_member",
        ],
        "images": [
            "check_pattern",
            "intensities_with_full_scale",
            "is_integer_image",
            "read_image",
            "read_with_full_scale",
        ],
        "layout": ["find_images"],
        "mosaic": ["Mosaic", "without_pattern"],
        "film_formats.raw_film": ["RawLayout"],
        "recording": ["FrameError", "Recording"],
        "still": ["MOST_BITS", "Still"],
        "stills": [
            "IMAGE_SUFFIXES",
            "image_size",
            "luminance",
            "read_still",
            "image_notes",
            "write_image",
        ],
    },
)
