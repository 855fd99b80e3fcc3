"""Numbers of pixels in little memory: as runs of consecutive ones.

The pixels that see a grid, or what is left of it, lie side by side: a run for each row of an image
says which they are, where their numbers would take more memory than the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo._compute.index_types import numbering


@dataclass(frozen=True, eq=False)
class PixelRuns:
    """Pixel numbers, in any order; those that ascend by one after another take no room.

    Attributes
    ----------
    first : (R,) int32 or int64
        The number with which each run begins.
    ptr : (R + 1,) int32 or int64
        How many numbers there are before each run, and in all.
    """

    first: NDArray[np.integer]
    ptr: NDArray[np.integer]

    @classmethod
    def all_of(cls, count: int) -> PixelRuns:
        """Return the numbers from 0 to ``count - 1``."""
        kind = numbering(count)
        return cls(np.zeros(1, kind), np.array([0, count], kind))

    @classmethod
    def of(cls, numbers: NDArray[np.integer], count: int) -> PixelRuns:
        """Return some ``numbers`` (P,), each below ``count``."""
        cuts = np.flatnonzero(np.diff(numbers) != 1) + 1
        begin = np.concatenate([np.zeros(min(len(numbers), 1), np.int64), cuts])
        kind = numbering(max(count, len(numbers)))
        return cls(numbers[begin].astype(kind), np.append(begin, len(numbers)).astype(kind))

    def __len__(self) -> int:
        """Return how many numbers there are."""
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
