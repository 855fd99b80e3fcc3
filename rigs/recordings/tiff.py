"""TIFF images by tifffile; headers that tifffile would read as black or noise are refused."""

from __future__ import annotations

import io
import logging
import math
import operator
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, errors_of_libraries

if TYPE_CHECKING:
    import tifffile

TIFF_MARKS = (b"II", b"MM")  # the first bytes of a file: its byte order

_NO_INTENSITIES = {
    "MINISWHITE": "white stored as zero, expected black as zero",
    "PALETTE": "numbers of a palette's colours, expected grey values",
    "CFA": "a mosaic of colour filters, expected grey values",
    "LOGL": "logarithms, expected values linear in intensity",
}
"""Photometric interpretations whose stored numbers are no intensities, with a message each."""


@contextmanager
def tiff_page(source: bytes | str | os.PathLike | BinaryIO) -> Iterator[tifffile.TiffPage]:
    """Yield the only page of a TIFF file, of which only the header has been read.

    Raises
    ------
    ValueError
        If the file has no page or several. tifffile raises other exceptions too.
    """
    import tifffile

    file = io.BytesIO(source) if isinstance(source, bytes) else source
    with _without_log("tifffile"), tifffile.TiffFile(file) as opened:
        if not opened.pages:
            raise ValueError("found no page, expected one")
        page = opened.pages[0]
        if opened.pages.get(1, default=page) is not page:  # counting a long chain takes long
            raise ValueError("found more than one page, expected one")
        yield page


def read_tiff(content: bytes) -> NDArray:
    """Return the image ``(rows, columns)`` or ``(rows, columns, channels)`` that a file holds.

    Raises
    ------
    ValueError
        If the file has not exactly one page of intensities, is damaged, or claims far more than
        it holds. tifffile and imagecodecs raise other exceptions too.
    """
    with tiff_page(content) as page:
        _check_intensities(page)
        _check_segments(page, len(content))
        with errors_of_libraries("damaged or truncated"):
            pixels = page.asarray()
        is_planar = page.planarconfig == 2 and page.samplesperpixel > 1
    if pixels.dtype == np.bool_:  # one bit a sample: black and white, as in other formats
        pixels = pixels * np.uint8(255)
    return np.moveaxis(pixels, 0, -1) if is_planar else pixels


@contextmanager
def _without_log(name: str) -> Iterator[None]:
    """Keep a library's log off the terminal: what matters is raised."""
    handler, logger = logging.NullHandler(), logging.getLogger(name)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def _check_intensities(page: tifffile.TiffPage) -> None:
    """Raise unless the header describes a page of intensities."""
    kind = getattr(page.photometric, "name", "")
    if kind in _NO_INTENSITIES:
        raise ValueError(f"found {_NO_INTENSITIES[kind]}")
    if min(page.imagewidth, page.imagelength) < 1:
        raise ValueError(
            f"found {page.imagewidth} x {page.imagelength} pixels, expected at least one"
        )
    if page.dtype is None or page.bitspersample not in (1, 8 * page.dtype.itemsize):
        raise ValueError(
            f"found {page.bitspersample} bits a sample of kind {page.sampleformat}, expected "
            "8 or 16, or floating point"
        )


def _check_segments(page: tifffile.TiffPage, size: int) -> None:
    """Raise unless a page's strips or tiles are all in a file of ``size`` bytes.

    tifffile leaves black what belongs to a missing one.
    """
    offsets, counts = page.dataoffsets, page.databytecounts
    expected = math.prod(page.chunked)
    if not len(offsets) == len(counts) == expected:
        raise ValueError(
            f"found {len(offsets)} strips and the sizes of {len(counts)}, expected {expected}"
        )
    end = max(map(operator.add, offsets, counts))
    if end > size:
        raise ValueError(f"found {size} bytes, expected {end}: truncated")
    if min(counts) < 1 or min(offsets) < 8:
        raise ValueError("found a strip without bytes, expected all of the image: damaged")
    claimed = page.nbytes
    if page.is_tiled:  # each tile is decoded whole, though the image ends inside it
        claimed = math.prod(page.chunks) * expected * page.dtype.itemsize
    check_claim(claimed, size)
