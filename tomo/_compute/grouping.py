"""Indices: entries of groups, ``ptr[g]:ptr[g + 1]``, even choices, and the type they need."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def take_groups(
    ptr: NDArray[np.int64], groups: NDArray[np.integer]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the ``ptr`` of some groups in the order given, and the indices of their entries."""
    counts = ptr[groups + 1] - ptr[groups]
    taken = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return taken, np.repeat(ptr[groups] - taken[:-1], counts) + np.arange(taken[-1])


def golden_ratio_sequence(count: int) -> NDArray[np.float64]:
    """Return ``count`` numbers in 0..1, the first ``n`` of them evenly spread for any ``n``.

    The Kronecker sequence ``frac(k (sqrt(5) - 1) / 2)``: it falls into step with no regular
    pattern, be it the rows of an image or the views of a ring.
    """
    multiples = np.arange(count) * ((5**0.5 - 1) / 2)
    return multiples - np.floor(multiples)


def index_type(count: int) -> np.dtype:
    """Return the smaller of int32 and int64 that holds ``count``, and so 0 to ``count`` and -1."""
    return np.dtype(np.int32 if count <= np.iinfo(np.int32).max else np.int64)
