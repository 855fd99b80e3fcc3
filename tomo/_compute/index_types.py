"""The integer type of indices: int32 takes half the memory, int64 counts past 2^31."""

from __future__ import annotations

import numpy as np


def index_type(count: int) -> np.dtype:
    """Return the smaller of int32 and int64 that holds ``count``, and so 0 to ``count`` and -1."""
    return np.dtype(np.int32 if count <= np.iinfo(np.int32).max else np.int64)
