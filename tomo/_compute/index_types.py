"""Which whole numbers count something: half as wide, half the memory, and twice as many a line."""

from __future__ import annotations

import numpy as np


def numbering(count: int) -> np.dtype:
    """Return the smaller of int32 and int64 that numbers ``count`` things from 0, and -1."""
    return np.dtype(np.int32 if count <= np.iinfo(np.int32).max else np.int64)
