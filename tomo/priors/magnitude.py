"""The priors that unknowns are small: their squares, or their magnitudes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
        return float(np.abs(values).sum(dtype=np.float64))

    def proximal_map(self, inverse: NDArray[np.float32], nonnegative: bool) -> ProximalMap:
        """Return the soft threshold ``sign(c) max(|c| - weight stretch C, 0)``, which is exact."""

        def soft(
            center: NDArray[np.float32], weight: float, steps: int, stretch: float = 1.0
        ) -> NDArray[np.float32]:
            threshold = np.float32(weight * stretch) * inverse
            above = np.maximum(center - threshold, np.float32(0))
            if nonnegative:
                return above
            return above - np.maximum(-center - threshold, np.float32(0))

        return soft
