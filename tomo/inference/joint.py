"""Voxels of one or several frames and effects in one least-squares problem, solved together.

Voxels and pixels are where products are computed, the parameters of effects are NumPy's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from tomo._compute.arrays import as_type, host, namespace, zeros
from tomo._compute.reductions import dot, largest, total
from tomo.inference.columns import (
    OwnColumns,
    SharedColumns,
    Unknowns,
    feasible,
    free_of,
    goes_below,
    rows_of,
    stacked,
    summed,
)
from tomo.operators.operator import ProjectionOperator
from tomo.priors import RelativeCurvature


@dataclass(frozen=True, eq=False)
class FrameProblem:
    """``||W^½ (b - A x - B o - T t - F f)||² + s ||D x||² + q ||o||²`` of one frame.

    Attributes
    ----------
    operator : ProjectionOperator
        ``A``, of the voxels in the grid.
    weights : (pixels,) float64
        ``W``, inverse variances, where the operator computes.
    prior : RelativeCurvature
        ``D``.
    strength : float
        ``s``, the inverse variance of the prior on voxels.
    own : (parameters, pixels) float64
        Columns of ``T`` of the parameters that each view has for itself.
    shared : (parameters, pixels) float64
        Columns of those that all views share.
    outside : ProjectionOperator, optional
        ``B``, of voxels around the grid.
    outside_strength : float
        ``q``.
    field : LinearOperator, optional
        ``F``, of the nodes of a field; its entries have one sign.
    """

    operator: ProjectionOperator
    weights: Any
    prior: RelativeCurvature
    strength: float
    own: NDArray[np.float64]
    shared: NDArray[np.float64]
    outside: ProjectionOperator | None = None
    outside_strength: float = 0.0
    field: LinearOperator | None = None

    @cached_property
    def _own(self) -> OwnColumns:
        return OwnColumns(self.own, self.operator.view_ptr, self.weights)

    @cached_property
    def _shared(self) -> SharedColumns:
        return SharedColumns(self.shared, self.weights)

    def _there(self, values: NDArray) -> Any:
        """Return values where the operator computes, in double precision."""
        return self.operator.array(np.asarray(values, np.float64))

    def forward(self, x: Any, o: Any, own: NDArray, shared: NDArray, nodes: NDArray) -> Any:
        """Return ``A x + B o + T t + F f``, ``(pixels,)`` float64."""
        pixels = as_type(self.operator @ as_type(x, np.float32), np.float64)
        if self.outside is not None:
            pixels = pixels + as_type(self.outside @ as_type(o, np.float32), np.float64)
        if len(self.own):
            pixels = pixels + self._own.forward(own)
        pixels = self._shared.added(pixels, shared)
        if self.field is not None:
            pixels = pixels + self._there(self.field @ nodes.astype(np.float32))
        return pixels

    def adjoint(self, pixels: Any) -> Unknowns:
        """Return the adjoint of `forward`: voxels ``(unknowns,)``, and so on."""
        single = as_type(pixels, np.float32)
        outside = zeros((0,), pixels) if self.outside is None else self.outside.T @ single
        nodes = np.zeros(0) if self.field is None else self.field.T @ host(single)
        return Unknowns(
            as_type(self.operator.T @ single, np.float64),
            as_type(outside, np.float64),
            self._own.adjoint(pixels),
            self._shared.adjoint(pixels),
            np.asarray(nodes, np.float64),
        )

    def _bent(self, x: Any) -> Any:
        return as_type(self.prior.forward(as_type(x, np.float32)), np.float64)

    def energy(self, x: Any, o: Any, image: Any) -> float:
        """Return the quadratic form of a direction, its parameters apart."""
        bent = self._bent(x)
        return (
            dot(image, self.weights * image)
            + self.strength * dot(bent, bent)
            + self.outside_strength * dot(o, o)
        )

    def downhill(self, x: Any, o: Any, residual: Any) -> Unknowns:
        """Return minus half the gradient, without the prior of the parameters."""
        g = self.adjoint(self.weights * residual)
        bent = self.prior.adjoint(as_type(self._bent(x), np.float32))
        bent = as_type(bent, np.float64)
        return g._replace(
            voxels=g.voxels - self.strength * bent, outside=g.outside - self.outside_strength * o
        )

    def diagonals(self) -> tuple[Any, Any]:
        """Return bounds of the normal matrix's diagonal, of voxels in and around the grid."""
        mean = total(as_type(self.prior.weights, np.float64)) / self.prior.weights.shape[0]
        curvature = 8 * self.strength * float(mean**2)
        x = as_type(self._diagonal_of(self.operator), np.float64) + curvature
        x = namespace(x).maximum(x, 1e-9 * max(float(largest(x)), 1e-30))
        if self.outside is None:
            return x, zeros((0,), x)
        return x, self._diagonal_of(self.outside) + self.outside_strength

    def _diagonal_of(self, operator: ProjectionOperator) -> Any:
        """Return ``A^T W A 1`` of an operator, ``(unknowns,)``."""
        lengths = self.weights * self._there(operator.row_sums)
        return operator.T @ as_type(lengths, np.float32)

    def field_diagonal(self) -> NDArray[np.float64]:
        """Return the same bound of the field's nodes, ``(nodes,)``."""
        if self.field is None:
            return np.zeros(0)
        weights = host(self.weights)
        return np.asarray(self.field.T @ (weights * (self.field @ np.ones(self.field.shape[1]))))

    def grams(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return ``T^T W T`` of each view's own parameters, and of those that views share."""
        return self._own.gram(), self._shared.gram()


@dataclass(frozen=True, eq=False)
class Joint:
    """The sum of the frames' problems, of ``||t + d||²`` and ``2 p'f``; x, o, f are above zero.

    Attributes
    ----------
    frames : sequence of FrameProblem
        Each of the same pixels and voxels.
    departure : tuple of (parameters, views) and (parameters,) float64
        ``d``: how far the parameters are from the mean of their priors already.
    pull : (nodes,) float64
        ``p``: how strongly each node of the field is pulled to zero.
    """

    frames: Sequence[FrameProblem]
    departure: tuple[NDArray[np.float64], NDArray[np.float64]]
    pull: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def forward(self, z: Unknowns) -> Any:
        """Return what each frame predicts, ``(frames, pixels)``."""
        each = zip(self.frames, rows_of(z.voxels), rows_of(z.outside), strict=True)
        return stacked([one.forward(x, o, *z[2:]) for one, x, o in each])

    def adjoint(self, pixels: Any) -> Unknowns:
        """Return the adjoint of `forward`."""
        each = zip(self.frames, rows_of(pixels), strict=True)
        return summed([one.adjoint(own) for one, own in each])

    def _energy(self, z: Unknowns, image: Any) -> float:
        """Return the quadratic form of a direction."""
        each = zip(self.frames, rows_of(z.voxels), rows_of(z.outside), rows_of(image), strict=True)
        parameters = float((z.own**2).sum() + (z.shared**2).sum())
        return sum(one.energy(x, o, own) for one, x, o, own in each) + parameters

    def _downhill(self, z: Unknowns, residual: Any) -> Unknowns:
        """Return minus half the gradient."""
        each = zip(
            self.frames, rows_of(z.voxels), rows_of(z.outside), rows_of(residual), strict=True
        )
        g = summed([one.downhill(x, o, own) for one, x, o, own in each])
        return g._replace(
            own=g.own - z.own - self.departure[0],
            shared=g.shared - z.shared - self.departure[1],
            nodes=g.nodes - self.pull,
        )

    def _preconditioner(self) -> Callable[[Unknowns, Unknowns], Unknowns]:
        """Return the map by a bound of the diagonal for voxels, by blocks for parameters."""
        x, o = map(stacked, zip(*(one.diagonals() for one in self.frames), strict=True))
        both = zip(*(one.grams() for one in self.frames), strict=True)
        grams, gram = (np.sum(each, axis=0) for each in both)
        blocks = np.asarray(np.linalg.inv(grams + np.eye(grams.shape[1])), np.float64)
        common = np.linalg.inv(gram + np.eye(len(gram)))
        nodes = np.sum([one.field_diagonal() for one in self.frames], axis=0)
        nodes = np.maximum(nodes, 1e-9 * nodes.max(initial=1e-30))  # no pixel sees some

        def apply(g: Unknowns, free: Unknowns) -> Unknowns:
            return Unknowns(
                g.voxels * free.voxels / x,
                g.outside * free.outside / o,
                np.einsum("vij,jv->iv", blocks, g.own),
                common @ g.shared,
                g.nodes * free.nodes / nodes,
            )

        return apply

    def solve(self, b: Any, z: Unknowns, iterations: int) -> tuple[Unknowns, Any]:
        """Return the unknowns after some iterations of projected conjugate gradients from ``z``.

        Also returns the residual ``b - A x - B o - T t - F f``, ``(frames, pixels)`` as ``b``.
        """
        precondition = self._preconditioner()
        residual = b - self.forward(z)
        direction, steep, size = z, z, 0.0
        for number in range(iterations):
            g = self._downhill(z, residual)
            free = free_of(z, g)
            before, size_before = steep, size
            steep = precondition(g, free)
            size = g.dot(steep)
            if not size > 0:
                break
            direction_before, direction = direction, steep
            if number > 0:
                turn = max(0.0, (size - g.dot(before)) / size_before)
                kept = (a * b for a, b in zip(direction_before, free, strict=True))
                direction = steep.plus(turn, Unknowns(*kept))
            image = self.forward(direction)
            step = g.dot(direction) / self._energy(direction, image)
            if not step > 0:
                break
            there = z.plus(step, direction)
            change = feasible(there).plus(-1.0, z)
            if any(goes_below(own) for own in (there.voxels, there.outside, there.nodes)):
                image = self.forward(change)
                energy = self._energy(change, image)
                step = min(max(g.dot(change) / energy, 0.0), 1.0) if energy > 0 else 0.0
                z = feasible(z.plus(step, change))
            else:
                z = there
            residual = residual - step * image
        return z, residual
