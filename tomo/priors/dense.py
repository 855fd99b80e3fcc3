"""Differences and total variation in arrays of any library; compiled on the CPU.

`tomo.priors.differences` and `tomo.priors.total_variation` have the same maps for NumPy's arrays,
and the formulas.
"""

from __future__ import annotations

import math
from typing import Any

from tomo._compute.arrays import namespace, single, zeros
from tomo.grid import ActiveVoxels
from tomo.grid.dense import pad, part


def differences(dense: Any, factors: list[float]) -> Any:
    """Return the forward differences ``(3, bx, by, bz, ...)`` of a box; none across its faces."""
    fields = []
    for axis, factor in enumerate(factors):
        count = dense.shape[axis]
        step = part(dense, axis, 1, count) - part(dense, axis, 0, count - 1)
        fields.append(pad(factor * step, axis, 0, 1))
    return namespace(dense).stack(fields)


def transposed_differences(field: Any, factors: list[float]) -> Any:
    """Return the transpose of `differences`, ``(bx, by, bz, ...)``."""
    dense = zeros(field.shape[1:], field)
    for axis, factor in enumerate(factors):
        step = factor * part(field[axis, ...], axis, 0, field.shape[1 + axis] - 1)
        dense = dense - pad(step, axis, 0, 1)  # in the order of `tomo.priors.differences`
        dense = dense + pad(step, axis, 1, 0)
    return dense


class DenseVariationProximal:
    """The proximal map of total variation, see `TotalVariationProximal`.

    ``factors`` are those of `Gradient`, ``inverse`` is (unknowns,) float32.
    """

    def __init__(
        self, active: ActiveVoxels, factors: list[float], inverse: Any, nonnegative: bool
    ) -> None:
        xp, self._dense = namespace(inverse), active.dense
        self._factors, self._nonnegative = factors, nonnegative
        self._inverse = self._dense.expand(inverse)
        beyond = zeros(self._inverse.shape, inverse)
        for axis, count in enumerate(self._inverse.shape):
            beyond = xp.maximum(beyond, pad(part(self._inverse, axis, 1, count), axis, 0, 1))
        bound = 2 * sum(factors) * max(factors) * (self._inverse + beyond)
        self._step = xp.where(bound > 0, 1 / xp.where(bound > 0, bound, 1.0), 0.0)
        self._dual = zeros((3, *self._inverse.shape), inverse)

    def __call__(self, center: Any, weight: float, steps: int, stretch: float = 1.0) -> Any:
        """Return nearly the minimum, see `TotalVariationProximal`."""
        xp, weight, stretch = namespace(center), single(weight), single(stretch)
        center, metric, step = (
            self._dense.expand(center), stretch * self._inverse, self._step / stretch,
        )  # fmt: skip

        def lowered(field: Any) -> Any:
            moved = center - metric * transposed_differences(field, self._factors)
            return xp.maximum(moved, 0.0) if self._nonnegative else moved

        ahead, last = self._dual, 1.0
        for _ in range(steps):
            following = (1 + math.sqrt(1 + 4 * last**2)) / 2
            raised = ahead + step * differences(lowered(ahead), self._factors)
            x, y, z = (raised[axis, ...] for axis in range(3))
            length = xp.sqrt(x * x + y * y + z * z)
            outside = length > weight
            raised = raised * xp.where(outside, weight / xp.where(outside, length, 1.0), 1.0)
            ahead = raised + single((last - 1) / following) * (raised - self._dual)
            self._dual, last = raised, following
        return self._dense.compress(lowered(self._dual))
