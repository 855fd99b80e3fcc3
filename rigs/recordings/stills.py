"""The one reader of still images: pixels and sizes, decoded by libraries behind one guard.

TIFF is read by tifffile, PNG by imagecodecs, PGM and PPM here, all other formats and their headers
by Pillow.
"""

from __future__ import annotations

import io
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.files.text import check_plain_file
from rigs.recordings.netpbm import is_netpbm, netpbm_size, read_netpbm
from rigs.recordings.still import Still
from rigs.recordings.tiff import TIFF_MARKS, read_tiff, tiff_page

if TYPE_CHECKING:
    from PIL import Image

IMAGE_SUFFIXES = (".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".webp")
"""Usual suffixes of the formats that `read_still` reads."""

_FORMATS = ("PNG", "JPEG", "BMP", "PPM", "WEBP")
_MODES = {"1": "L", "L": "L", "I": "I", "F": "F", "RGBA": "RGBA"}
"""Pillow's modes of images that are not PNG, to those that are decoded; all others become RGB."""


def read_still(path: str | os.PathLike) -> Still:
    """Return an image file's pixels as stored.

    Parameters
    ----------
    path : path-like
        A TIFF, PNG, JPEG, BMP, PGM, PPM or WebP file; its content tells which.

    Returns
    -------
    still : Still
        Row 0 first, whatever the file says about the way it is viewed; `image_notes` tells. A
        palette is replaced by its colours.

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
    check_plain_file(path)
    content = path.read_bytes()
    with errors_of_libraries(f"{path}: not a readable image"):
        if content.startswith(TIFF_MARKS):
            return read_tiff(content)
        return read_netpbm(content) if is_netpbm(content) else Still.of(_decode(content))


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
    check_plain_file(path)
    with path.open("rb") as file, errors_of_libraries(f"{path}: not a readable image"):
        head = file.read(2)
        file.seek(0)
        if is_netpbm(head):
            return netpbm_size(file.read())
        if head not in TIFF_MARKS:
            return header_of(file if head else b"").size
        with tiff_page(file) as page:
            return page.imagewidth, page.imagelength


def luminance(pixels: NDArray) -> NDArray:
    """Return the grey image ``(rows, columns)`` of the pixels of a `Still`.

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


def header_of(source: bytes | BinaryIO) -> Image.Image:
    """Return an image of a format that Pillow reads, of which only the header has been read."""
    from PIL import Image, UnidentifiedImageError

    if source == b"":
        raise ValueError("the file is empty")
    file = io.BytesIO(source) if isinstance(source, bytes) else source
    try:
        with warnings.catch_warnings(action="ignore"):  # of large images: `check_claim` decides
            return Image.open(file, formats=_FORMATS)
    except UnidentifiedImageError:
        raise ValueError(
            "damaged or of another format, expected PNG, JPEG, TIFF, BMP, PGM or WebP"
        ) from None


def _decode(content: bytes) -> NDArray:
    image = header_of(content)
    # no sample of these formats has more than two bytes
    check_claim(2 * image.width * image.height * len(image.getbands()), len(content))
    mode = _MODES.get(image.mode, "RGB")
    with errors_of_libraries("damaged or truncated"):
        if image.format == "PNG":  # Pillow reduces colours of 16 bits to 8
            import imagecodecs

            return imagecodecs.png_decode(content)
        pixels = np.array(image if image.mode == mode else image.convert(mode))
    return pixels.astype(np.uint16) if mode == "I" else pixels
