"""Entries in groups, ``ptr[g]:ptr[g + 1]``: rays of pixels, and crossings of rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def take_groups(
    ptr: NDArray[np.int64], groups: NDArray[np.integer]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the ``ptr`` of some groups in the order given, and the numbers of their entries."""
    counts = ptr[groups + 1] - ptr[groups]
    taken = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return taken, np.repeat(ptr[groups] - taken[:-1], counts) + np.arange(taken[-1])
