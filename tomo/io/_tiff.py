"""Images out of TIFF files' bytes: what a page claims is looked at before it is decoded."""

from __future__ import annotations

import io
import logging
import math
import operator
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.files.archives import check_unpacked
from rigs.recordings.decoded import decoded

if TYPE_CHECKING:
    import tifffile

_LZW = 5
_LEFT_TO_OPENCV = (_LZW, 7)  # LZW and JPEG: tifffile alone does not decompress them
_DEFLATE = (8, 32946)
_DENSEST = {1: 1, 5: 1500, 7: 1500, 8: 1100, 32946: 1100, 32773: 64}
"""By kind of compression: the bytes that one stored byte can stand for, at the most."""

_NO_INTENSITIES = {
    "MINISWHITE": "white stored as zero, expected black as zero",
    "PALETTE": "numbers of a palette's colours, expected grey values",
    "CFA": "a mosaic of colour filters, expected grey values",
    "LOGL": "logarithms, expected values linear in intensity",
}
"""By what a page says of it: what its one sample a pixel is instead."""


def decoded_tiff(content: bytes) -> NDArray:
    """Return the image ``(rows, columns)`` or ``(rows, columns, channels)`` that a file holds.

    Raises
    ------
    ValueError
        If it is none, has several pages, is damaged, or claims to hold far more than it does.
        What tifffile raises besides may be anything.
    """
    import tifffile

    with _unlogged("tifffile"), tifffile.TiffFile(io.BytesIO(content)) as file:
        if not file.pages:
            raise ValueError("found no page, expected one")
        page = file.pages[0]
        if file.pages.get(1, default=page) is not page:  # to count them all may take long
            raise ValueError("found more than one page, expected one")
        _check_page(page)
        _check_strips(page, len(content))
        if page.compression in _LEFT_TO_OPENCV:
            image = decoded(content)
            if page.compression == _LZW and page.samplesperpixel == 1:
                _check_lzw(page, content)
            return image
        check_unpacked(max(page.nbytes, 2 * page.size), len(content))
        if page.compression in _DEFLATE:
            _check_inflated(page, content)
        return page.asarray()


@contextmanager
def _unlogged(name: str) -> Iterator[None]:
    """Keep what a library logs of foreign files off the terminal: what matters is raised."""
    handler, logger = logging.NullHandler(), logging.getLogger(name)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def _check_page(page: tifffile.TiffPage) -> None:
    """Raise unless a page says of itself what a page of intensities can be."""
    kind = getattr(page.photometric, "name", "")
    if kind in _NO_INTENSITIES:
        raise ValueError(f"found {_NO_INTENSITIES[kind]}")
    size = (page.imagewidth, page.imagelength)
    if min(size) < 1:
        raise ValueError(f"found {size[0]} x {size[1]} pixels, expected at least one")
    if page.is_tiled and min(page.tilewidth, page.tilelength) < 1:
        raise ValueError(
            f"found tiles of {page.tilewidth} x {page.tilelength} pixels, expected at least one"
        )
    if page.dtype is None:
        raise ValueError(
            f"found {page.bitspersample} bits a sample of kind {page.sampleformat}, expected "
            "8 or 16, or floating point"
        )
    if page.compression not in _DENSEST:
        raise ValueError(
            f"found compression {page.compression}, expected none, deflate, LZW, PackBits or JPEG"
        )


def _check_strips(page: tifffile.TiffPage, size: int) -> None:
    """Raise unless a page's strips or tiles are all in a file of ``size`` bytes, and apart."""
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
    stored = sum(counts)
    if stored > size:
        raise ValueError(f"found {size} bytes, expected {stored}: strips overlap")
    whole = page.size * page.bitspersample // 8
    if whole > stored * _DENSEST[page.compression]:
        raise ValueError(f"found strips of {stored} bytes, too few for {whole}: truncated")


def _check_inflated(page: tifffile.TiffPage, content: bytes) -> None:
    """Raise if a page's strips unpack to more than the page."""
    width, length = page.imagewidth, page.imagelength
    overhang = (width + page.tilewidth) * (length + page.tilelength)  # of tiles; strips have none
    most = page.nbytes * overhang // (width * length)
    check_unpacked(most, len(content))
    most += 1 << 20
    for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        strip = zlib.decompressobj()
        most -= len(strip.decompress(content[offset : offset + count], max(most, 0) + 1))
        if most < 0:
            raise ValueError(f"found strips of more than {page.nbytes} bytes, expected no more")


def _check_lzw(page: tifffile.TiffPage, content: bytes) -> None:
    """Raise if a strip unpacks to less than its rows: OpenCV leaves them black."""
    from tomo.io._lzw import unpacked_length

    rows, columns = (
        (page.tilelength, page.tilewidth)
        if page.is_tiled
        else (page.rowsperstrip, page.imagewidth)
    )
    for number, (offset, count) in enumerate(
        zip(page.dataoffsets, page.databytecounts, strict=True)
    ):
        strip = content[offset : offset + count]
        if strip.startswith(b"\0\1"):  # lowest bit first, as before TIFF 6: none writes it now
            raise ValueError("found LZW of an old kind, expected that of TIFF 6")
        if not page.is_tiled:
            rows = min(page.rowsperstrip, page.imagelength - number * page.rowsperstrip)
        expected = rows * (-(-columns * page.bitspersample // 8))
        found = unpacked_length(np.frombuffer(strip, np.uint8))
        if found < expected:
            raise ValueError(f"found {found} bytes in a strip, expected {expected}: damaged")
