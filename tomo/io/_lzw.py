"""How much a stream of TIFF's LZW unpacks to: decoders may leave black what is missing of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

CLEAR, END = 256, 257
CODES = 4096


@compiled()
def unpacked_length(stream: NDArray[np.uint8]) -> int:
    """Return the number of bytes that a stream unpacks to, up to its end or the first wrong code.

    Parameters
    ----------
    stream : (bytes,) uint8
        Codes of 9 to 12 bits, the highest bit first.

    Notes
    -----
    A code stands for a byte, or for what an earlier code stood for and one byte more: to count
    takes the lengths alone. The width of codes changes one code early, as TIFF has it.
    """
    lengths = np.ones(CODES, np.int64)
    following, width, previous = END + 1, 9, 0
    total = held = bits = 0
    for byte in stream:
        held = ((held << 8) | byte) & 0xFFFFFF
        bits += 8
        if bits < width:
            continue
        bits -= width
        code = (held >> bits) & ((1 << width) - 1)
        if code == END:
            break
        if code == CLEAR:
            following, width, previous = END + 1, 9, 0
            continue
        if code > following or (previous == 0 and code > CLEAR):
            break
        length = previous + 1 if code == following else lengths[code]
        if previous and following < CODES:
            lengths[following] = previous + 1
            following += 1
        total += length
        previous = length
        if following == 511 or following == 1023 or following == 2047:
            width = 10 if following == 511 else 11 if following == 1023 else 12
    return total
