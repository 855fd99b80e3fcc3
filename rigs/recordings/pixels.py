"""Still images as stored: their pixels and their size, decoded by libraries behind one guard.

TIFF is read by tifffile, PNG by imagecodecs, all other formats and their headers by Pillow.
"""

from __future__ import annotations

import io
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.recordings.tiff import TIFF_MARKS, read_tiff, tiff_page

if TYPE_CHECKING:
    from PIL import Image

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp")
"""Usual suffixes of the formats that `read_pixels` reads."""

_FORMATS = ("PNG", "JPEG", "BMP", "PPM", "WEBP")
_MODES = {"1": "L", "L": "L", "I": "I", "F": "F", "RGBA": "RGBA"}
"""Pillow's modes of images that are not PNG, to those that are decoded; all others become RGB."""


def read_pixels(path: str | os.PathLike) -> NDArray:
    """Return the pixels of an image file as stored.

    Parameters
    ----------
    path : path-like
        A TIFF, PNG, JPEG, BMP, PGM or WebP file; its content tells which.

    Returns
    -------
    pixels : (rows, columns) or (rows, columns, channels) array
        Row 0 first, whatever the file says about the way it is viewed. Channels are grey and
        alpha, or red, green, blue and alpha; a palette is replaced by its colours.

    Raises
    ------
    ValueError
        If the file is no image of intensities, is truncated or damaged, or claims to be far
        larger than it is.
    OSError
        If the file cannot be opened.

    Notes
    -----
    JPEG has no check sum: data damaged inside are decoded as they are. TIFF and PNG are the
    formats for measurements.
    """
    path = Path(path)
    content = path.read_bytes()
    with errors_of_libraries(f"{path}: not a readable image"):
        return read_tiff(content) if content.startswith(TIFF_MARKS) else _decode(content)


def image_size(path: str | os.PathLike) -> tuple[int, int]:
    """Return the width and height in pixels that an image file claims; no pixel is decoded.

    Raises
    ------
    ValueError
        If the file is no image.
    OSError
        If the file cannot be opened.
    """
    path = Path(path)
    content = path.read_bytes()
    with errors_of_libraries(f"{path}: not a readable image"):
        if not content.startswith(TIFF_MARKS):
            return _header(content).size
        with tiff_page(content) as page:
            return page.imagewidth, page.imagelength


def luminance(pixels: NDArray) -> NDArray:
    """Return the grey image ``(rows, columns)`` of pixels as `read_pixels` returns them.

    Notes
    -----
    ``0.299 R + 0.587 G + 0.114 B`` (ITU-R BT.601); alpha is ignored.
    """
    if pixels.ndim == 2 or pixels.shape[2] <= 2:
        return pixels.reshape(*pixels.shape[:2], -1)[:, :, 0]
    import cv2

    if pixels.dtype not in (np.uint8, np.uint16):
        pixels = pixels.astype(np.float32)  # OpenCV converts no other type
    return cv2.cvtColor(np.ascontiguousarray(pixels[:, :, :3]), cv2.COLOR_RGB2GRAY)


def _header(content: bytes) -> Image.Image:
    """Return an image of which only the header has been read."""
    from PIL import Image, UnidentifiedImageError

    if not content:
        raise ValueError("the file is empty")
    try:
        with warnings.catch_warnings(action="ignore"):  # of large images: `check_claim` decides
            return Image.open(io.BytesIO(content), formats=_FORMATS)
    except UnidentifiedImageError:
        raise ValueError(
            "damaged or of another format, expected PNG, JPEG, TIFF, BMP, PGM or WebP"
        ) from None


def _decode(content: bytes) -> NDArray:
    image = _header(content)
    # no sample of these formats has more than two bytes
    check_claim(2 * image.width * image.height * len(image.getbands()), len(content))
    mode = _MODES.get(image.mode, "RGB")
    with errors_of_libraries("damaged or truncated"):
        if image.format == "PNG":  # Pillow reduces colours of 16 bits to 8
            import imagecodecs

            return imagecodecs.png_decode(content)
        pixels = np.array(image if image.mode == mode else image.convert(mode))
    return pixels.astype(np.uint16) if mode == "I" else pixels
