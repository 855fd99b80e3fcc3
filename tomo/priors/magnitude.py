"""The priors that unknowns are small: their squares, or their magnitudes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import namespace, single
from tomo._compute.reductions import total
from tomo.grid import ActiveVoxels
from tomo.priors.total_variation import ProximalMap


class Magnitude:
    """The identity: ``||x||²`` counts the squares of the unknowns themselves."""

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``x``."""
        return values

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``p``."""
        return field


class L1:
    """The sum of magnitudes ``sum |x|``: few unknowns are bright.

    Parameters
    ----------
    active : ActiveVoxels
        All unknowns count alike.
    """

    def __init__(self, active: ActiveVoxels) -> None:
        self._active = active

    def value(self, values: NDArray[np.float32]) -> float:
        """Return ``sum |x|`` of the unknowns ``x`` (unknowns,)."""
        return float(total(namespace(values).abs(values)))

    def proximal_map(self, inverse: NDArray[np.float32], nonnegative: bool) -> ProximalMap:
        """Return the soft threshold ``sign(c) max(|c| - weight stretch C, 0)``, which is exact."""

        def soft(
            center: NDArray[np.float32], weight: float, steps: int, stretch: float = 1.0
        ) -> NDArray[np.float32]:
            xp, threshold = namespace(center), single(weight * stretch) * inverse
            above = xp.maximum(center - threshold, 0.0)
            return above if nonnegative else above - xp.maximum(-center - threshold, 0.0)

        return soft
