"""The compiled loop of `tomo._compute.reductions`."""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled


@compiled(reassociate=True)
def inner_product(a, b):
    """Return the sum of the products of two vectors of one length, in double precision."""
    total = 0.0
    for i in range(len(a)):
        total += np.float64(a[i]) * np.float64(b[i])
    return total
