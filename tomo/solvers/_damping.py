"""From where on what rays and voxels barely share is too little to divide by.

A ray that grazes the grid, or what carving left of it, has next to no length in it. The noise of
its pixel over so little would throw the few voxels that it meets far off: a step is divided by a
share of what is usual instead, which leaves every solution of consistent equations as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BARELY_CROSSED = 0.1
"""Share of the median row's size below which a row's step is damped."""


def damped(sizes: NDArray[np.floating], share: float = BARELY_CROSSED) -> NDArray[np.floating]:
    """Return sizes, each at least a share of the median of those above zero; 1 where none is."""
    above = sizes[sizes > 0]
    return np.maximum(sizes, share * float(np.median(above)) if len(above) else 1.0)
