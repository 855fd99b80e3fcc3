"""Taking some of many: entries in groups, ``ptr[g]:ptr[g + 1]``, and evenly spread choices."""

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


def golden_section(count: int) -> NDArray[np.float64]:
    """Return ``count`` places in 0..1 of which the first few, however many, are spread evenly.

    Multiples of the golden section, modulo 1: they fall into step with no regular pattern, such
    as the rows of an image or the views of a ring.
    """
    places = np.arange(count) * ((5**0.5 - 1) / 2)
    return places - np.floor(places)
