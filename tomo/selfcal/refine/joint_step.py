"""One Gauss-Newton step for cameras and volumes together.

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
"""Coefficients ``(moments, unknowns)`` and per-view parameters ``(cameras moved, 8)``."""


@dataclass(frozen=True, eq=False)
class SeenMoment:
    """The volume of a moment and its images, to first order.

    Attributes
    ----------
    free : (unknowns,) bool
        True for coefficients that may change. A dark voxel stays dark.
    derivatives : sequence of (8, pixels of the view) float64
        ``J_v``, one for each of the cameras to move.
    """

    free: NDArray[np.bool_]
    derivatives: Sequence[NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class JointStep:
    """The linear least-squares problem of one step.

    It minimises ``sum_m ( || r_m - A G c_m - sum_v J_mv d_v ||² + s || c_m ||² ) + sum_v w_v ||
    d_v + p_v ||²`` over the changes ``c_m`` of the volumes of all moments and the change ``d`` of
    the per-view parameters, in units of the standard deviations of their priors.

    Attributes
    ----------
    operator : ProjectionOperator
        ``A G``.
    views : sequence of int
        The cameras to move.
    moments : sequence of SeenMoment
    weights : (cameras moved,) float64
        ``w_v``: the weight of the prior, the residual variance per pixel; see `weight_of`.
    departures : (cameras moved, 8) float64
        ``p_v``: the parameters' distance from the mean of the prior.
    """

    operator: ProjectionOperator
    views: Sequence[int]
    moments: Sequence[SeenMoment]
    weights: NDArray[np.float64]
    departures: NDArray[np.float64]

    def solve(self, residuals: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return the step of the parameters, ``(cameras moved, 8)``.

        The solver is conjugate gradients. The preconditioner is a bound of the normal matrix's
        diagonal for the coefficients, and the inverse of the diagonal block for each camera.

        Parameters
        ----------
        residuals : sequence of (pixels,) float64
            One a moment.
        """
        free = np.stack([one.free for one in self.moments])
        if not free.any():
            return np.zeros_like(self.departures)
        volume = self.operator
        bound = volume.T @ (volume @ np.ones(volume.shape[1]))
        bound = np.maximum(bound, 1e-9 * bound.max(initial=0.0))
        stiffness = STIFFNESS * float(np.median(np.broadcast_to(bound, free.shape)[free]))
        blocks = [
            np.linalg.inv(sum(map(_products, own)) + weight * np.eye(len(own[0])))
            for own, weight in zip(self._of_views(), self.weights, strict=True)
        ]

        def preconditioned(g: Vectors) -> Vectors:
            parts = [block @ own for block, own in zip(blocks, g[1], strict=True)]
            return g[0] / (bound + stiffness), np.stack(parts)

        c, d = np.zeros(free.shape), np.zeros_like(self.departures)
        gradient = self._adjoint(residuals)
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

    def _forward(self, x: Vectors) -> list[NDArray[np.float64]]:
        found = []
        for moment, own in zip(self.moments, x[0], strict=True):
            pixels = np.asarray(self.operator @ (moment.free * own), np.float64)
            for view, derivatives, step in zip(self.views, moment.derivatives, x[1], strict=True):
                pixels[self._span(view)] += np.sum(step[:, None] * derivatives, axis=0)
            found.append(pixels)
        return found

    def _adjoint(self, y: Sequence[NDArray[np.float64]]) -> Vectors:
        volumes, cameras = [], np.zeros_like(self.departures)
        for moment, pixels in zip(self.moments, y, strict=True):
            volumes.append(moment.free * (self.operator.T @ pixels))
            for number, view in enumerate(self.views):
                own = moment.derivatives[number] * pixels[self._span(view)]
                cameras[number] += np.sum(own, axis=1)
        return np.stack(volumes), cameras

    def _of_views(self) -> list[list[NDArray[np.float64]]]:
        """Return the derivatives of each view at all moments."""
        return [list(own) for own in zip(*(m.derivatives for m in self.moments), strict=True)]

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
    return dot(a[0].ravel(), b[0].ravel()) + dot(a[1], b[1])
