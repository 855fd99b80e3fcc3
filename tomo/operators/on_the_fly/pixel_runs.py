"""Pixel numbers as runs of consecutive ones, and as parts of several sources.

The pixels that see a grid lie side by side: one run for each row of an image takes little memory,
where their numbers would take more than the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo._compute.grouping import index_type


@dataclass(frozen=True, eq=False)
class PixelRuns:
    """Pixel numbers in any order, stored as runs that ascend by one.

    Attributes
    ----------
    first : (R,) int32 or int64
        The number with which each run begins.
    ptr : (R + 1,) int32 or int64
        How many numbers stand before each run, and in all.
    """

    first: NDArray[np.integer]
    ptr: NDArray[np.integer]

    @classmethod
    def all_of(cls, count: int) -> PixelRuns:
        """Return the numbers from 0 to ``count - 1``."""
        kind = index_type(count)
        return cls(np.zeros(1, kind), np.array([0, count], kind))

    @classmethod
    def of(cls, numbers: NDArray[np.integer], count: int) -> PixelRuns:
        """Return some ``numbers`` (P,), each below ``count``."""
        cuts = np.flatnonzero(np.diff(numbers) != 1) + 1
        begin = np.concatenate([np.zeros(min(len(numbers), 1), np.int64), cuts])
        kind = index_type(max(count, len(numbers)))
        return cls(numbers[begin].astype(kind), np.append(begin, len(numbers)).astype(kind))

    def __len__(self) -> int:
        """Return the number of pixels."""
        return int(self.ptr[-1])

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<PixelRuns: {len(self)} pixels in {len(self.first)} runs>"

    def run_of(self, number: int) -> int:
        """Return the run in which the pixel at ``number`` is."""
        return int(np.searchsorted(self.ptr, number, side="right")) - 1

    def between(self, start: int, stop: int) -> NDArray[np.integer]:
        """Return the numbers at ``start:stop``: (stop - start,)."""
        low, high = np.searchsorted(self.ptr[1:-1], [start, stop - 1], side="right")
        some = slice(int(low), int(high) + 1)
        ends = np.clip(self.ptr[low : high + 2], start, stop)
        shift = np.repeat(self.first[some] - self.ptr[some], np.diff(ends))
        return np.arange(start, stop, dtype=self.first.dtype) + shift


def pixels_between(ptr: NDArray[np.int64], start: int, stop: int) -> list[tuple[int, slice]]:
    """Return the sources of pixels ``start:stop``, and the slice of each source's own pixels.

    Pixels are numbered one source after another; ``ptr`` (sources + 1,) says where each begins.
    """
    first, last = np.searchsorted(ptr, [start, stop], side="right") - 1
    found = []
    for number in range(first, min(last, len(ptr) - 2) + 1):
        low, high = ptr[number : number + 2].tolist()
        if max(start, low) < min(stop, high):
            found.append((number, slice(max(start, low) - low, min(stop, high) - low)))
    return found


def pixels_by_source(
    ptr: NDArray[np.int64], pixels: NDArray[np.integer]
) -> list[tuple[int, NDArray[np.integer]]]:
    """Return, for each run of ``pixels`` in one source, the source and its own pixel numbers.

    In the order of ``pixels``; a source with several runs comes several times.
    """
    if not len(pixels):
        return []
    source = np.searchsorted(ptr, pixels, side="right") - 1
    cuts = np.flatnonzero(np.diff(source)) + 1
    runs = zip(source[np.append(0, cuts)].tolist(), np.split(pixels, cuts), strict=True)
    return [(number, some - ptr[number]) for number, some in runs]
