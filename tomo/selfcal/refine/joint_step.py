"""One step of Gauss and Newton's method for cameras and volume at once.

A volume made from images with wrong cameras has taken in a part of the cameras' errors: what is
left in the residuals understates them, and cameras corrected by residuals alone creep. So the
volume is free in the step that moves the cameras: the part of a residual that another volume
explains as well says nothing about them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import dot
from tomo.operators.operator import ProjectionOperator

ITERATIONS = 30
DONE = 1e-5
"""Conjugate gradients end when the preconditioned residual has fallen to this share."""

STIFFNESS = 1e-3
"""Of the volume against change, as a share of what rays say of a typical voxel."""

FAINTEST = 1e-50
"""Intensity that no pixel is fainter than, in any unit; its square is one of double precision."""

SMALLEST = 1e-9
"""Share of a view's squared residuals that a weight is at least."""

Vectors = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Coefficients ``(unknowns,)`` and the parameters of the cameras ``(cameras, 8)``."""


@dataclass(frozen=True, eq=False)
class JointStep:
    """The linear least squares of one step.

    ``|| r - A G c - sum_v J_v d_v ||² + w_v || d_v + p_v ||² + s || c ||²`` over the volume's
    change ``c`` and the parameters' ``d``, in units of their priors' standard deviations.

    Attributes
    ----------
    operator : ProjectionOperator
        ``A G``.
    free : (unknowns,) bool
        Coefficients that may change: a voxel without light stays dark.
    views : sequence of int
        The cameras to move.
    derivatives : sequence of (8, pixels of the view) float64
        ``J_v``, one for each of ``views``.
    weights : (cameras moved,) float64
        ``w_v``: the variance of what a pixel says of a parameter.
    departures : (cameras moved, 8) float64
        ``p_v``: how far the parameters are from the prior's mean.
    """

    operator: ProjectionOperator
    free: NDArray[np.bool_]
    views: Sequence[int]
    derivatives: Sequence[NDArray[np.float64]]
    weights: NDArray[np.float64]
    departures: NDArray[np.float64]

    def solve(self, residual: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the step of the parameters, ``(cameras moved, 8)``.

        By conjugate gradients, the coefficients preconditioned by a bound of their normal
        matrix's diagonal, each camera's parameters by the inverse of their own block.
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

        def conditioned(g: Vectors) -> Vectors:
            parts = [block @ own for block, own in zip(blocks, g[1], strict=True)]
            return g[0] / (bound + stiffness), np.stack(parts)

        c, d = np.zeros(volume.shape[1]), np.zeros_like(self.departures)
        downhill = self._adjoint(residual)
        g = downhill[0], downhill[1] - self.weights[:, None] * self.departures
        z = conditioned(g)
        direction, size = z, _dot(g, z)
        first = size
        for _ in range(ITERATIONS):
            if not size > DONE**2 * first:
                break
            h = self._adjoint(self._forward(direction))
            h = (
                h[0] + stiffness * direction[0],
                h[1] + self.weights[:, None] * direction[1],
            )
            step = size / _dot(direction, h)
            c, d = c + step * direction[0], d + step * direction[1]
            g = g[0] - step * h[0], g[1] - step * h[1]
            z = conditioned(g)
            size, before = _dot(g, z), size
            turn = size / before
            direction = z[0] + turn * direction[0], z[1] + turn * direction[1]
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
    """Return the variance of what a pixel says of a parameter, residuals of a tile as one.

    ``mean_k sum_tiles (sum J_k r)² / sum J_k²``: the residuals' variance where they are noise;
    where they come from the volume, the optics or the cameras they agree over stretches, and many
    pixels say hardly more than one: the prior then counts for more.

    Parameters
    ----------
    derivatives : (parameters, pixels)
    residual : (pixels,)
    tiles : (pixels,) int
        Which tile a pixel belongs to.
    """
    ratios = []
    for own in derivatives:
        information = dot(own, own)
        if information > 0:
            ratios.append(np.sum(np.square(np.bincount(tiles, own * residual))) / information)
    found = float(np.mean(ratios)) if ratios else 0.0
    # above zero, so that the prior decides where a camera sees nothing or all fits exactly
    return max(found, SMALLEST * dot(residual, residual), FAINTEST**2)


def _products(derivatives: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``J J^T`` whatever the number of threads."""
    return np.array([[dot(a, b) for b in derivatives] for a in derivatives])


def _dot(a: Vectors, b: Vectors) -> float:
    return dot(a[0], b[0]) + dot(a[1], b[1])
