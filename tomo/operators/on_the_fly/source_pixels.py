"""Pixels of several sources, numbered one source after another: which of which source they are.

``ptr`` ``(sources + 1,)`` says where each source's pixels begin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def pixels_between(ptr: NDArray[np.int64], start: int, stop: int) -> list[tuple[int, slice]]:
    """Return the sources that have pixels of ``start:stop``, and which of their own these are."""
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
    """Return runs of ``pixels``, in their order, that are of one source: it, and which of its own.

    A source comes as often as there are runs.
    """
    if not len(pixels):
        return []
    source = np.searchsorted(ptr, pixels, side="right") - 1
    cuts = np.flatnonzero(np.diff(source)) + 1
    runs = zip(source[np.append(0, cuts)].tolist(), np.split(pixels, cuts), strict=True)
    return [(number, some - ptr[number]) for number, some in runs]
