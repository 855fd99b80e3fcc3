"""Image sizes for formats whose files do not hold them."""

from __future__ import annotations

from pathlib import Path


def size_of_image(path: Path) -> tuple[int, int] | None:
    """Return width and height of an image, or None where there is none that can be read."""
    if not path.is_file():
        return None
    import cv2

    try:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    return None if image is None else (image.shape[1], image.shape[0])


def required_size(
    given: tuple[int, int] | None, format_name: str, image: Path | None = None
) -> tuple[int, int]:
    """Return the size given, else that of ``image``, or say that it is needed."""
    size = given or (image and size_of_image(image))
    if not size:
        beside = f", or the image {image} beside the file" if image else ""
        raise ValueError(
            f"image_size: missing, as {format_name} files hold none, "
            f"expected --image-size WIDTHxHEIGHT{beside}"
        )
    return size
