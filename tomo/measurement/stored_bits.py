"""How many bits of 16 an image holds: cameras of 10, 12 and 14 bits write files of 16."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

FULL = int(np.iinfo(np.uint16).max)
"""The largest number of 16 bits."""

FEWER = (10, 12, 14)
"""Bits of cameras that are stored in 16."""

SATURATED = 2
"""Pixels at exactly the largest number of fewer bits that show where a camera ends. One may be
chance; a largest value that is no such number, or far below, says nothing about bits."""

DISTINCT = 16
"""Values that must all be multiples of a power of two. Fewer may be so by chance, like the levels
of a drawing."""


@dataclass(frozen=True)
class StoredBits:
    """What the numbers of an image of 16 bits say about the camera's."""

    largest: int  # number in the image
    pixels: int  # how many have it
    bits: int | None = None  # that the camera uses, where the numbers show fewer than 16
    shift: int = 0  # bits that its numbers were shifted up by: 4 where 12 bits are multiples of 16

    @property
    def full_scale(self) -> int:
        """The largest number that the camera can write."""
        return FULL if self.bits is None else (2**self.bits - 1) << self.shift


def stored_bits(counts: ArrayLike) -> StoredBits:
    """Return what the numbers ``(rows, columns)`` of an image of 16 bits say about the camera.

    Notes
    -----
    Numbers end at the largest of 10, 12 or 14 bits where two pixels or more have exactly that and
    none has more: the camera was saturated there. They are shifted up where at least 16 different
    ones are all multiples of 4, 8, 16 ...

    Examples
    --------
    >>> stored_bits([[100, 4095, 4095], [7, 300, 2000]])
    StoredBits(largest=4095, pixels=2, bits=12, shift=0)
    """
    numbers = np.asarray(counts).astype(np.uint16, copy=False)
    largest = int(numbers.max(initial=0))
    pixels = int(np.count_nonzero(numbers == largest))
    every = int(np.bitwise_or.reduce(numbers, axis=None)) if largest else 0
    shift = (every & -every).bit_length() - 1 if every else 0
    if shift >= 2 and np.count_nonzero(np.bincount(numbers.ravel() >> shift)) >= DISTINCT:
        return StoredBits(largest, pixels, 16 - shift, shift)
    bits = largest.bit_length()
    if bits in FEWER and largest == 2**bits - 1 and pixels >= SATURATED:
        return StoredBits(largest, pixels, bits)
    return StoredBits(largest, pixels)
