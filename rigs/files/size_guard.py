"""The guard before libraries' decoders: what a file claims to hold, against its size and a limit.

A few bytes may claim to be gigabytes, and a decoder believes them. Every reader of foreign bytes
compares the claim of the header here, then leaves the decoding to a library.
"""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

_ANY_HEADER = zlib.MAX_WBITS | 32  # zlib or gzip, as the stream says

ALWAYS_ALLOWED = 128 << 20
"""Bytes that any file may unpack to: less refuses masks of large cameras, which pack to almost
nothing; more lets a small damaged file take that much memory."""

RATIO = 32
"""Unpacked bytes that each stored byte may add: measured fields pack to a tenth at the least."""

_PIECE = 1 << 24  # bytes unpacked at a time: little beside what any file may unpack to


def largest_claim(stored: int) -> int:
    """Return how many bytes a file of ``stored`` bytes may unpack to."""
    return ALWAYS_ALLOWED + RATIO * stored


def check_claim(claimed: int, stored: int) -> None:
    """Raise unless a file of ``stored`` bytes may unpack to ``claimed`` bytes.

    Raises
    ------
    ValueError
        Naming both.
    """
    if claimed < 0:
        raise ValueError(f"found a claim of {claimed} bytes, expected 0 or more: damaged")
    most = largest_claim(stored)
    if claimed > most:
        raise ValueError(
            f"found {stored} bytes that claim to hold {claimed}, expected at most {most}: the "
            "file is damaged, or has to be stored without compression"
        )


def decompressed(data: bytes | bytearray, most: int, method: str = "zlib") -> bytearray:
    """Return what a compressed stream holds, which may be ``most`` bytes.

    Parameters
    ----------
    data : bytes
    most : int
        Decompression stops there.
    method : str
        ``"zlib"`` for zlib and gzip streams, ``"bzip2"``.

    Raises
    ------
    ValueError
        If the stream holds more, is truncated or claims more than `check_claim` allows.
    """
    check_claim(most, len(data))
    stream = bz2.BZ2Decompressor() if method == "bzip2" else zlib.decompressobj(_ANY_HEADER)
    found = bytearray()  # grows in place, where one call would hold the values twice
    while not stream.eof and len(found) <= most:
        piece = stream.decompress(data, min(_PIECE, most + 1 - len(found)))
        data = getattr(stream, "unconsumed_tail", b"")  # bz2 keeps what is left
        if not piece and not data:
            break
        found += piece
    if len(found) > most:
        raise ValueError(f"found compressed values of more than {most} bytes, expected no more")
    if not stream.eof:
        raise ValueError("found no end of the compressed values: truncated")
    return found


@contextmanager
def errors_of_libraries(where: str) -> Iterator[None]:
    """Turn any exception that a library raises over foreign bytes into one line of ValueError."""
    try:
        yield
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{where}: {reason}") from None
