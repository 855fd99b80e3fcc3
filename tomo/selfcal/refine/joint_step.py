"""One Gauss-Newton step for cameras and volume together.

A volume reconstructed with wrong cameras absorbs a part of the cameras' errors. The residuals then
understate these errors, and corrections from residuals alone converge slowly. The volume is
therefore free in the step that moves the cameras (variable projection): a residual that another
volume explains as well is no evidence about the cameras.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import dot
from tomo.operators.operator import ProjectionOperator

ITERATIONS = 30
"""Iterations of conjugate gradients at most. Fewer give a short step; more take longer."""

TOLERANCE = 1e-5
"""Ratio to which the preconditioned residual must fall. Higher, the step is inexact; lower,
iterations are spent on digits that the next step changes."""

STIFFNESS = 1e-3
"""Prior strength of the volume's change, as a fraction of a typical diagonal of the normal matrix.
Lower, undetermined voxels slow the solver; higher, the volume explains too little."""

FAINTEST = 1e-50
"""Lower bound of an intensity, in any unit. Lower, its square is no double; higher, images in
faint units are cut off."""

SMALLEST = 1e-9
"""Lower bound of a weight, as a fraction of the view's squared residuals. Lower, the step becomes
singular; higher, the prior holds cameras that fit exactly."""

Vectors = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Coefficients ``(unknowns,)`` and per-view parameters ``(cameras moved, 8)``."""


@dataclass(frozen=True, eq=False)
class JointStep:
    """The linear least-squares problem of one step.

    It minimises ``|| r - A G c - sum_v J_v d_v ||² + w_v || d_v + p_v ||² + s || c ||²`` over the
    change ``c`` of the volume and the change ``d`` of the per-view parameters, in units of the
    standard deviations of their priors.

    Attributes
    ----------
    operator : ProjectionOperator
        ``A G``.
    free : (unknowns,) bool
        True for coefficients that may change. A dark voxel stays dark.
    views : sequence of int
        The cameras to move.
    derivatives : sequence of (8, pixels of the view) float64
        ``J_v``, one for each of ``views``.
    weights : (cameras moved,) float64
        ``w_v``: the weight of the prior, the residual variance per pixel; see `weight_of`.
    departures : (cameras moved, 8) float64
        ``p_v``: the parameters' distance from the mean of the prior.
    """

    operator: ProjectionOperator
    free: NDArray[np.bool_]
    views: Sequence[int]
    derivatives: Sequence[NDArray[np.float64]]
    weights: NDArray[np.float64]
    departures: NDArray[np.float64]

    def solve(self, residual: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the step of the parameters, ``(cameras moved, 8)``.

        The solver is conjugate gradients. The preconditioner is a bound of the normal matrix's
        diagonal for the coefficients, and the inverse of the diagonal block for each camera.

        Parameters
        ----------
        residual : (pixels,) float64
        """
        if not self.free.any():
            return np.zeros_like(self.departures)
        volume = self.operator
        bound = volume.T @ (volume @ np.ones(volume.shape[1]))
        bound = np.maximum(bound, 1e-9 * bound.max(initial=0.0))
        stiffness = STIFFNESS * float(np.median(bound[self.free]))
        blocks = [
            np.linalg.inv(_products(own) + weight * np.eye(len(own)))
            for own, weight in zip(self.derivatives, self.weights, strict=True)
        ]

        def preconditioned(g: Vectors) -> Vectors:
            parts = [block @ own for block, own in zip(blocks, g[1], strict=True)]
            return g[0] / (bound + stiffness), np.stack(parts)

        c, d = np.zeros(volume.shape[1]), np.zeros_like(self.departures)
        gradient = self._adjoint(residual)
        g = gradient[0], gradient[1] - self.weights[:, None] * self.departures
        z = preconditioned(g)
        direction, size = z, _dot(g, z)
        first = size
        for _ in range(ITERATIONS):
            if not size > TOLERANCE**2 * first:
                break
            h = self._adjoint(self._forward(direction))
            h = (
                h[0] + stiffness * direction[0],
                h[1] + self.weights[:, None] * direction[1],
            )
            step = size / _dot(direction, h)
            c, d = c + step * direction[0], d + step * direction[1]
            g = g[0] - step * h[0], g[1] - step * h[1]
            z = preconditioned(g)
            size, before = _dot(g, z), size
            beta = size / before
            direction = z[0] + beta * direction[0], z[1] + beta * direction[1]
        return d

    def _forward(self, x: Vectors) -> NDArray[np.float64]:
        pixels = np.asarray(self.operator @ (self.free * x[0]), np.float64)
        for view, derivatives, own in zip(self.views, self.derivatives, x[1], strict=True):
            pixels[self._span(view)] += np.sum(own[:, None] * derivatives, axis=0)
        return pixels

    def _adjoint(self, y: NDArray[np.float64]) -> Vectors:
        own = [
            np.sum(derivatives * y[self._span(view)], axis=1)
            for view, derivatives in zip(self.views, self.derivatives, strict=True)
        ]
        return self.free * (self.operator.T @ y), np.stack(own)

    def _span(self, view: int) -> slice:
        return slice(*self.operator.view_ptr[view : view + 2])


def weight_of(
    derivatives: NDArray[np.float64], residual: NDArray[np.float64], tiles: NDArray[np.integer]
) -> float:
    """Return the weight of a camera's prior: the residual variance per independent pixel.

    It is ``mean_k sum_tiles (sum J_k r)² / sum J_k²``, in squared intensity. For residuals that
    are noise this is their variance. Residuals from errors of the volume, the optics or the
    cameras are correlated, and many pixels then carry little more information than one. The weight
    of the prior is then larger.

    Parameters
    ----------
    derivatives : (parameters, pixels)
    residual : (pixels,)
    tiles : (pixels,) int
        The tile number of each pixel. Residuals within a tile count as correlated.
    """
    ratios = []
    for own in derivatives:
        information = dot(own, own)
        if information > 0:
            ratios.append(np.sum(np.square(np.bincount(tiles, own * residual))) / information)
    found = float(np.mean(ratios)) if ratios else 0.0
    # above zero: the prior decides where a camera sees nothing or the fit is exact
    return max(found, SMALLEST * dot(residual, residual), FAINTEST**2)


def _products(derivatives: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``J J^T``, with the same bits for any number of threads."""
    return np.array([[dot(a, b) for b in derivatives] for a in derivatives])


def _dot(a: Vectors, b: Vectors) -> float:
    return dot(a[0], b[0]) + dot(a[1], b[1])
