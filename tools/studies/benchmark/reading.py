"""The machine's bandwidth: a large array that is read and nothing else."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

LARGE = (64, 1_000_000)  # 256 MB: beyond every cache; many more rows than threads


@numba.njit(parallel=True, fastmath={"reassoc", "nsz", "contract"})
def _sum_rows(values, sums) -> None:
    for part in numba.prange(len(sums)):
        row, total = values[part], np.float32(0)
        for place in range(len(row)):
            total += row[place]
        sums[part] = total


def read(values: NDArray[np.float32]) -> None:
    """Read ``values``, of the shape `LARGE`, on all threads."""
    _sum_rows(values, np.zeros(len(values), np.float32))
