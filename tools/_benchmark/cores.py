"""What further threads can gain at most: work without memory, which only cores can limit.

Two threads of one core share its arithmetic: where a machine's cores are such threads, arithmetic
gains nothing by them, and what waits for its own results gains all.
"""

from __future__ import annotations

import numba
import numpy as np

from tomo._compile import compiled

PARTS = 64  # many more than threads, so that all end at about the same time
ROUNDS = 4_000_000
_ABREAST = 48  # sums beside each other: enough for two units of four lanes to wait for none


@compiled(parallel=True, reassociate=True)
def _arithmetic(sums) -> None:
    """Multiply and add numbers that stay in registers, as many at once as a core can."""
    for part in numba.prange(len(sums)):
        values = np.zeros(_ABREAST)
        for _ in range(ROUNDS // _ABREAST):
            for lane in range(_ABREAST):
                values[lane] = values[lane] * 0.999 + 0.5
        sums[part] = values.sum()


@compiled(parallel=True)
def _waiting(sums) -> None:
    """Take roots of roots: each begins when the one before has ended."""
    for part in numba.prange(len(sums)):
        value = 0.5
        for _ in range(ROUNDS // _ABREAST):
            value = np.sqrt(value + 1.0)
        sums[part] = value


def arithmetic() -> None:
    """Do nothing but arithmetic, on all threads."""
    _arithmetic(np.zeros(PARTS))


def waiting() -> None:
    """Do nothing but wait for results, on all threads."""
    _waiting(np.zeros(PARTS))
