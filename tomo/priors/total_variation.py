"""Proximal priors: total variation, for few sharp edges, and the sum of magnitudes."""

from __future__ import annotations

import math
from typing import Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import host, is_numpy, namespace, single
from tomo._compute.jit import compiled
from tomo._compute.reductions import total
from tomo._compute.threads import threads_worth
from tomo.grid import ActiveVoxels
from tomo.priors.dense import DenseVariationProximal
from tomo.priors.differences import NANOSECONDS_ADJOINT, NANOSECONDS_FORWARD, Gradient


@compiled(inline=True)
def _difference(volume, i, j, k, factors):
    """Return the scaled forward differences at a voxel; zero across the grid's upper faces."""
    here = volume[i, j, k]
    x = factors[0] * (volume[i + 1, j, k] - here) if i + 1 < volume.shape[0] else np.float32(0)
    y = factors[1] * (volume[i, j + 1, k] - here) if j + 1 < volume.shape[1] else np.float32(0)
    z = factors[2] * (volume[i, j, k + 1] - here) if k + 1 < volume.shape[2] else np.float32(0)
    return x, y, z


@compiled(inline=True)
def _divergence(field, i, j, k, factors):
    """Return ``(D^T p)`` at a voxel: minus the divergence, by backward differences."""
    nx, ny, nz = field.shape[0], field.shape[1], field.shape[2]
    total = np.float32(0)
    if i + 1 < nx:
        total -= factors[0] * field[i, j, k, 0]
    if j + 1 < ny:
        total -= factors[1] * field[i, j, k, 1]
    if k + 1 < nz:
        total -= factors[2] * field[i, j, k, 2]
    if i > 0:
        total += factors[0] * field[i - 1, j, k, 0]
    if j > 0:
        total += factors[1] * field[i, j - 1, k, 1]
    if k > 0:
        total += factors[2] * field[i, j, k - 1, 2]
    return total


@compiled(parallel=True)
def _raise_dual(volume, inverse, stretch, factors, weight, momentum, dual, ahead):
    """Step the dual field up its gradient, back into its balls, and extrapolate it, in place.

    The step is 1 over the row sum of ``|D C D^T|``, which bounds its largest eigenvalue voxel by
    voxel (Pock and Chambolle 2011, lemma 2).
    """
    nx, ny, nz = volume.shape
    span = np.float32(2) * (factors[0] + factors[1] + factors[2])
    span *= stretch * max(factors[0], factors[1], factors[2])
    for plane in numba.prange(nx):
        i = np.int64(plane)
        for j in range(ny):
            for k in range(nz):
                beyond = np.float32(0)
                if i + 1 < nx:
                    beyond = max(beyond, inverse[i + 1, j, k])
                if j + 1 < ny:
                    beyond = max(beyond, inverse[i, j + 1, k])
                if k + 1 < nz:
                    beyond = max(beyond, inverse[i, j, k + 1])
                bound = span * (inverse[i, j, k] + beyond)
                if bound == 0:  # nothing here can change
                    continue
                step = np.float32(1) / bound
                x, y, z = _difference(volume, i, j, k, factors)
                x = ahead[i, j, k, 0] + step * x
                y = ahead[i, j, k, 1] + step * y
                z = ahead[i, j, k, 2] + step * z
                length = np.sqrt(x * x + y * y + z * z)
                if length > weight:
                    shrink = weight / length
                    x *= shrink
                    y *= shrink
                    z *= shrink
                ahead[i, j, k, 0] = x + momentum * (x - dual[i, j, k, 0])
                ahead[i, j, k, 1] = y + momentum * (y - dual[i, j, k, 1])
                ahead[i, j, k, 2] = z + momentum * (z - dual[i, j, k, 2])
                dual[i, j, k, 0] = x
                dual[i, j, k, 1] = y
                dual[i, j, k, 2] = z


@compiled(parallel=True)
def _lower_primal(center, inverse, stretch, factors, lowest, field, volume):
    """Set ``volume`` to ``max(center - stretch C D^T field, lowest)``."""
    for plane in numba.prange(volume.shape[0]):
        i = np.int64(plane)
        for j in range(volume.shape[1]):
            for k in range(volume.shape[2]):
                moved = stretch * inverse[i, j, k] * _divergence(field, i, j, k, factors)
                volume[i, j, k] = max(center[i, j, k] - moved, lowest)


class ProximalMap(Protocol):
    """The proximal map of a prior in one metric; it may keep its state between calls."""

    def __call__(
        self, center: NDArray[np.float32], weight: float, steps: int, stretch: float = 1.0
    ) -> NDArray[np.float32]:
        """Return nearly the minimum of ``½ (x - c)^T C^-1 (x - c) / stretch + weight R(x)``."""


class ProximalPrior(Protocol):
    """A convex prior ``R(x)`` that is known by its proximal map."""

    def proximal_map(self, inverse: NDArray[np.float32], nonnegative: bool) -> ProximalMap:
        """Return the map in the metric ``C^-1`` of the diagonal ``C`` (unknowns,)."""


class TotalVariation:
    """Isotropic total variation: the sum over voxels of ``|D x|``.

    Notes
    -----
    ``TV(x) = sum_v sqrt(sum_a (D x)_va²)`` with the differences ``D`` of `Gradient`.
    """

    def __init__(self, active: ActiveVoxels) -> None:
        self._active = active

    def value(self, values: NDArray[np.float32]) -> float:
        """Return ``TV(x)`` of the unknowns ``x`` (unknowns,)."""
        field = Gradient(self._active).forward(host(values))
        return float(np.sqrt(np.square(field, dtype=np.float64).sum(axis=0)).sum())

    def proximal_map(self, inverse: NDArray[np.float32], nonnegative: bool) -> ProximalMap:
        """Return the proximal map in the metric ``C^-1``, with a bound at zero or not."""
        if not is_numpy(inverse):
            factors = Gradient(self._active).factors.tolist()
            return DenseVariationProximal(self._active, factors, inverse, nonnegative)
        return TotalVariationProximal(self._active, inverse, nonnegative)


class TotalVariationProximal:
    """The proximal map of total variation by fast gradient projection on the dual.

    ``inverse`` (unknowns,) is ``C``, the inverse of the map's diagonal metric.

    Notes
    -----
    The dual field is kept from one call to the next, which then needs few steps. Fields cover the
    box around the active voxels, one layer of zeros included where the grid goes on.

    References
    ----------
    Beck and Teboulle, "Fast gradient-based algorithms for constrained total variation image
    denoising and deblurring problems", IEEE Transactions on Image Processing 18 (2009).
    """

    def __init__(
        self, active: ActiveVoxels, inverse: NDArray[np.float32], nonnegative: bool
    ) -> None:
        self._box = active.box
        self._factors = Gradient(active).factors
        self._inverse = self._in_box(inverse)  # zero where no voxel is active: those stay zero
        self._lowest = np.float32(0 if nonnegative else -np.inf)
        self._dual = np.zeros((*self._inverse.shape, 3), np.float32)

    def _in_box(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the unknowns in the box, zero where none is: ``(bx, by, bz)``, a copy."""
        return self._box.expand(values.astype(np.float32)).reshape(self._box.grid.shape)

    def __call__(
        self, center: NDArray[np.float32], weight: float, steps: int, stretch: float = 1.0
    ) -> NDArray[np.float32]:
        """Return nearly the minimum of ``½ (x - c)^T C^-1 (x - c) / stretch + weight TV(x)``.

        By so many ``steps`` on the dual.
        """
        center = self._in_box(center)
        volume = np.zeros_like(center)
        ahead = self._dual.copy()
        last = 1.0
        metric = self._inverse, np.float32(stretch), self._factors
        with threads_worth((NANOSECONDS_FORWARD + NANOSECONDS_ADJOINT) * volume.size):
            for _ in range(steps):
                _lower_primal(center, *metric, self._lowest, ahead, volume)
                following = (1 + math.sqrt(1 + 4 * last**2)) / 2
                momentum = np.float32((last - 1) / following)
                last = following
                _raise_dual(volume, *metric, np.float32(weight), momentum, self._dual, ahead)
            _lower_primal(center, *metric, self._lowest, self._dual, volume)
        return self._box.compress(volume)


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
