"""The images that cameras wrote, read as stored: linear, row 0 first."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "images": [
            "SCAN_SUFFIXES",
            "intensities",
            "is_integer_image",
            "read_image",
            "write_image",
        ],
        "pixels": ["IMAGE_SUFFIXES", "image_size", "luminance", "read_pixels"],
    },
)
