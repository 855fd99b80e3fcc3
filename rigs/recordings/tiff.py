"""TIFF images by tifffile; headers that tifffile would read as black or noise are refused."""

from __future__ import annotations

import io
import logging
import math
import operator
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO, cast

import numpy as np

from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.recordings.still import Still
from rigs.recordings.tiff_planes import check_chain

if TYPE_CHECKING:
    import tifffile

TIFF_MARKS = (b"II", b"MM")  # the first bytes of a file: its byte order

_NO_INTENSITIES = {
    "MINISWHITE": "white stored as zero, expected black as zero",
    "PALETTE": "numbers of a palette's colours, expected grey values",
    "LOGL": "logarithms, expected values linear in intensity",
    "LOGLUV": "logarithms, expected values linear in intensity",
    "SEPARATED": "colours of printing inks, expected grey values",
    **dict.fromkeys(("CIELAB", "ICCLAB", "ITULAB"), "CIE Lab colours, expected grey values"),
}
"""Photometric interpretations whose stored numbers are no intensities, with a message each."""

_TO_RGB = ("JPEG", "OJPEG", "JPEG_2000_LOSSY", "WEBP")
"""Compressions whose decoder turns brightness and colour differences into red, green and blue."""

_MOST_PAGES = 4
"""Pages of a file with one image: the image, a thumbnail, a mask. Following a long chain of pages
takes long."""


@contextmanager
def tiff_page(source: bytes | str | os.PathLike | BinaryIO) -> Iterator[tifffile.TiffPage]:
    """Yield the page of a TIFF file that is the image; only headers have been read.

    Other pages, thumbnails and masks, have a tag, or sides at most half as long as the image's.
    """
    with opened_tiff(source) as file:
        yield image_page(file)


@contextmanager
def opened_tiff(source: bytes | str | os.PathLike | BinaryIO) -> Iterator[tifffile.TiffFile]:
    """Yield a TIFF file whose library says nothing on the terminal."""
    import tifffile

    file = io.BytesIO(source) if isinstance(source, bytes) else source
    with silent_log(), tifffile.TiffFile(file) as opened:
        yield opened


def read_tiff(content: bytes) -> Still:
    """Return the image that a file holds."""
    with tiff_page(content) as page:
        return decoded(page, len(content))


def decoded(page: tifffile.TiffPage, size: int) -> Still:
    """Return the image of a page in a file of ``size`` bytes; see `read_tiff`."""
    _check_intensities(page)
    _check_segments(page, size)
    with errors_of_libraries("damaged or truncated"):
        pixels = page.asarray()
    if page.planarconfig == 2 and page.samplesperpixel > 1:
        pixels = np.moveaxis(pixels, 0, -1)
    return Still.of(pixels, bits_of(page), is_pattern(page))


def is_pattern(page: tifffile.TiffPage) -> bool:
    """Return whether a page says that it is a mosaic of colour filters."""
    return getattr(page.photometric, "name", "") == "CFA"


def bits_of(page: tifffile.TiffPage) -> int | None:
    """Return how many bits were recorded of a pixel; None for floating-point numbers."""
    return page.bitspersample if page.dtype is not None and page.dtype.kind in "biu" else None


@contextmanager
def silent_log() -> Iterator[None]:
    """Keep tifffile's log off the terminal: what matters is raised."""
    handler, logger = logging.NullHandler(), logging.getLogger("tifffile")
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def image_page(file: tifffile.TiffFile) -> tifffile.TiffPage:
    """Return the one page that is no thumbnail and no mask, see `tiff_page`."""
    if not file.pages:
        raise ValueError("found no page, expected one")
    pages = [file.pages.first]
    while len(pages) <= _MOST_PAGES:
        page = cast("tifffile.TiffPage", file.pages.get(len(pages), default=pages[0]))
        if page is pages[0]:
            break
        pages.append(page)
    whole = [page for page in pages if not (page.is_reduced or page.is_mask)]
    if not whole:  # raw files of cameras: the thumbnail comes first and holds the image
        inner = [cast("tifffile.TiffPage", one) for page in pages for one in page.pages or ()]
        whole = [page for page in inner if not (page.is_reduced or page.is_mask)]
    if not whole:
        raise ValueError("found only thumbnails, expected an image")
    largest = max(whole, key=lambda page: page.imagewidth * page.imagelength)
    others = (page for page in whole if page is not largest)
    if len(pages) > _MOST_PAGES or not all(_is_thumbnail(page, largest) for page in others):
        raise ValueError("found more than one page, expected one: store each frame as a file")
    check_chain(file)
    return largest


def _is_thumbnail(page: tifffile.TiffPage, image: tifffile.TiffPage) -> bool:
    return 2 * page.imagewidth <= image.imagewidth and 2 * page.imagelength <= image.imagelength


def _check_intensities(page: tifffile.TiffPage) -> None:
    """Raise unless the header describes a page of intensities."""
    kind = getattr(page.photometric, "name", "")
    if kind in _NO_INTENSITIES:
        raise ValueError(f"found {_NO_INTENSITIES[kind]}")
    if min(page.imagewidth, page.imagelength) < 1:
        raise ValueError(f"found {page.imagewidth} x {page.imagelength} pixels, expected some")
    if page.dtype is None or not isinstance(page.bitspersample, int):
        raise ValueError(
            f"found {page.bitspersample} bits a sample of kind {page.sampleformat}, expected "
            "1 to 32, or floating point"
        )
    if kind == "YCBCR" and getattr(page.compression, "name", "") not in _TO_RGB:
        raise ValueError("found brightness and colour differences, expected grey values")


def _check_segments(page: tifffile.TiffPage, size: int) -> None:
    """Raise unless a page's strips or tiles are all in a file of ``size`` bytes."""
    # tifffile leaves black what belongs to a missing one
    offsets, counts = page.dataoffsets, page.databytecounts
    expected = math.prod(page.chunked)
    if not len(offsets) == len(counts) == expected:
        raise ValueError(f"found {len(offsets)} strips, {len(counts)} sizes, expected {expected}")
    end = max(map(operator.add, offsets, counts))
    if end > size:
        raise ValueError(f"found {size} bytes, expected {end}: truncated")
    if min(counts) < 1 or min(offsets) < 8:
        raise ValueError("found a strip without bytes, expected all of the image: damaged")
    claimed = page.nbytes
    if page.is_tiled:  # each tile is decoded whole, though the image ends inside it
        claimed = math.prod(page.chunks) * expected * np.dtype(page.dtype).itemsize
    check_claim(claimed, size)
