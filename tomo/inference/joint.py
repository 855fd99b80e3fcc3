"""Voxels of one or several frames and effects in one least-squares problem, solved together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from tomo._compute.reductions import dot
from tomo.operators.operator import ProjectionOperator
from tomo.priors import RelativeCurvature


class Unknowns(NamedTuple):
    """Voxels, voxels around the grid, parameters of the views, those that views share, a field.

    Each frame has its own voxels; the others are common to all frames. Parameters are in standard
    deviations of their priors.
    """

    voxels: NDArray[np.float64]  # (frames, unknowns)
    outside: NDArray[np.float64]  # (frames, outside unknowns)
    own: NDArray[np.float64]  # (parameters, views)
    shared: NDArray[np.float64]  # (parameters,)
    nodes: NDArray[np.float64]  # (nodes,), of the field

    def plus(self, step: float, other: Unknowns) -> Unknowns:
        """Return the sum with ``step`` times another."""
        return Unknowns(*(a + step * b for a, b in zip(self, other, strict=True)))

    def dot(self, other: Unknowns) -> float:
        """Return the inner product."""
        return sum(dot(a.ravel(), b.ravel()) for a, b in zip(self, other, strict=True))


@dataclass(frozen=True, eq=False)
class FrameProblem:
    """``||W^½ (b - A x - B o - T t - F f)||² + s ||D x||² + q ||o||²`` of one frame.

    Attributes
    ----------
    operator : ProjectionOperator
        ``A``, of the voxels in the grid.
    weights : (pixels,) float64
        ``W``, inverse variances.
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
    weights: NDArray[np.float64]
    prior: RelativeCurvature
    strength: float
    own: NDArray[np.float64]
    shared: NDArray[np.float64]
    outside: ProjectionOperator | None = None
    outside_strength: float = 0.0
    field: LinearOperator | None = None

    @cached_property
    def _views(self) -> list[slice]:
        """The pixels of each view."""
        ptr = self.operator.view_ptr
        return [slice(a, b) for a, b in zip(ptr[:-1].tolist(), ptr[1:].tolist(), strict=True)]

    def view_sums(self, values: NDArray[np.float64], pixels: NDArray) -> NDArray[np.float64]:
        """Return the inner products over each view, ``(k, views)`` of ``(k, pixels)``."""
        found = np.zeros((len(values), len(self._views)))
        for view, own in enumerate(self._views if len(values) else ()):
            found[:, view] = np.einsum("kp,p->k", values[:, own], pixels[own])
        return found

    def forward(
        self, x: NDArray, o: NDArray, own: NDArray, shared: NDArray, nodes: NDArray
    ) -> NDArray[np.float64]:
        """Return ``A x + B o + T t + F f``, ``(pixels,)``."""
        pixels = np.asarray(self.operator @ x.astype(np.float32), np.float64)
        if self.outside is not None:
            pixels = pixels + np.asarray(self.outside @ o.astype(np.float32), np.float64)
        for view, rows in enumerate(self._views if len(self.own) else ()):
            pixels[rows] += np.einsum("kp,k->p", self.own[:, rows], own[:, view])
        for column, value in zip(self.shared, shared, strict=True):
            pixels = pixels + column * value
        if self.field is not None:
            pixels = pixels + np.asarray(self.field @ nodes.astype(np.float32), np.float64)
        return pixels

    def adjoint(self, pixels: NDArray[np.float64]) -> Unknowns:
        """Return the adjoint of `forward`: voxels ``(unknowns,)``, and so on."""
        single = pixels.astype(np.float32)
        outside = np.zeros(0) if self.outside is None else self.outside.T @ single
        nodes = np.zeros(0) if self.field is None else self.field.T @ single
        return Unknowns(
            np.asarray(self.operator.T @ single, np.float64),
            np.asarray(outside, np.float64),
            self.view_sums(self.own, pixels),
            np.einsum("kp,p->k", self.shared, pixels),
            np.asarray(nodes, np.float64),
        )

    def _bent(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.prior.forward(x.astype(np.float32)).astype(np.float64)

    def energy(self, x: NDArray, o: NDArray, image: NDArray[np.float64]) -> float:
        """Return the quadratic form of a direction, its parameters apart."""
        bent = self._bent(x)
        return (
            dot(image, self.weights * image)
            + self.strength * dot(bent, bent)
            + self.outside_strength * dot(o, o)
        )

    def downhill(self, x: NDArray, o: NDArray, residual: NDArray[np.float64]) -> Unknowns:
        """Return minus half the gradient, without the prior of the parameters."""
        g = self.adjoint(self.weights * residual)
        bent = self.prior.adjoint(self._bent(x).astype(np.float32)).astype(np.float64)
        return g._replace(
            voxels=g.voxels - self.strength * bent, outside=g.outside - self.outside_strength * o
        )

    def diagonals(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return bounds of the normal matrix's diagonal, of voxels in and around the grid."""
        curvature = 8 * self.strength * float(np.mean(self.prior.weights.astype(np.float64)) ** 2)
        lengths = self.weights * np.asarray(self.operator.row_sums)
        x = np.asarray(self.operator.T @ lengths.astype(np.float32), np.float64) + curvature
        x = np.maximum(x, 1e-9 * x.max(initial=1e-30))
        if self.outside is None:
            return x, np.zeros(0)
        lengths = self.weights * np.asarray(self.outside.row_sums)
        o = np.asarray(self.outside.T @ lengths.astype(np.float32)) + self.outside_strength
        return x, o

    def field_diagonal(self) -> NDArray[np.float64]:
        """Return the same bound of the field's nodes, ``(nodes,)``."""
        if self.field is None:
            return np.zeros(0)
        return np.asarray(
            self.field.T @ (self.weights * (self.field @ np.ones(self.field.shape[1])))
        )

    def grams(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return ``T^T W T`` of each view's own parameters, and of those that views share."""
        k = len(self.own)
        own = np.zeros((len(self._views), k, k))
        for n, column in enumerate(self.own):
            own[:, n] = self.view_sums(self.own, self.weights * column).T
        return own, np.einsum("kp,p,lp->kl", self.shared, self.weights, self.shared)


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

    def forward(self, z: Unknowns) -> NDArray[np.float64]:
        """Return what each frame predicts, ``(frames, pixels)``."""
        each = zip(self.frames, z.voxels, z.outside, strict=True)
        return np.stack([one.forward(x, o, *z[2:]) for one, x, o in each])

    def adjoint(self, pixels: NDArray[np.float64]) -> Unknowns:
        """Return the adjoint of `forward`."""
        return _summed([one.adjoint(own) for one, own in zip(self.frames, pixels, strict=True)])

    def _energy(self, z: Unknowns, image: NDArray[np.float64]) -> float:
        """Return the quadratic form of a direction."""
        each = zip(self.frames, z.voxels, z.outside, image, strict=True)
        parameters = float((z.own**2).sum() + (z.shared**2).sum())
        return sum(one.energy(x, o, own) for one, x, o, own in each) + parameters

    def _downhill(self, z: Unknowns, residual: NDArray[np.float64]) -> Unknowns:
        """Return minus half the gradient."""
        each = zip(self.frames, z.voxels, z.outside, residual, strict=True)
        g = _summed([one.downhill(x, o, own) for one, x, o, own in each])
        return g._replace(
            own=g.own - z.own - self.departure[0],
            shared=g.shared - z.shared - self.departure[1],
            nodes=g.nodes - self.pull,
        )

    def _preconditioner(self) -> Callable[[Unknowns, Unknowns], Unknowns]:
        """Return the map by a bound of the diagonal for voxels, by blocks for parameters."""
        x, o = map(np.stack, zip(*(one.diagonals() for one in self.frames), strict=True))
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

    def solve(
        self, b: NDArray[np.float64], z: Unknowns, iterations: int
    ) -> tuple[Unknowns, NDArray[np.float64]]:
        """Return the unknowns after some iterations of projected conjugate gradients from ``z``.

        Also returns the residual ``b - A x - B o - T t - F f``, ``(frames, pixels)`` as ``b``.
        """
        precondition = self._preconditioner()
        residual = b - self.forward(z)
        direction, steep, size = z, z, 0.0
        for number in range(iterations):
            g = self._downhill(z, residual)
            free = _free(z, g)
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
            change = _feasible(there).plus(-1.0, z)
            if any((own < 0).any() for own in (there.voxels, there.outside, there.nodes)):
                image = self.forward(change)
                energy = self._energy(change, image)
                step = min(max(g.dot(change) / energy, 0.0), 1.0) if energy > 0 else 0.0
                z = _feasible(z.plus(step, change))
            else:
                z = there
            residual = residual - step * image
        return z, residual


def _summed(each: Sequence[Unknowns]) -> Unknowns:
    """Return the voxels of every frame, and the sums of their parameters."""
    return Unknowns(
        np.stack([one.voxels for one in each]),
        np.stack([one.outside for one in each]),
        np.sum([one.own for one in each], axis=0),
        np.sum([one.shared for one in each], axis=0),
        np.sum([one.nodes for one in each], axis=0),
    )


def _free(z: Unknowns, downhill: Unknowns) -> Unknowns:
    """Return 1 for what may change: what is above zero, or would rise."""
    return Unknowns(
        np.where((z.voxels <= 0) & (downhill.voxels <= 0), 0.0, 1.0),
        np.where((z.outside <= 0) & (downhill.outside <= 0), 0.0, 1.0),
        np.ones_like(z.own),
        np.ones_like(z.shared),
        np.where((z.nodes <= 0) & (downhill.nodes <= 0), 0.0, 1.0),
    )


def _feasible(z: Unknowns) -> Unknowns:
    """Return the nearest unknowns of which no voxel and no node is below zero."""
    voxels, outside, nodes = (np.maximum(own, 0) for own in (z.voxels, z.outside, z.nodes))
    return z._replace(voxels=voxels, outside=outside, nodes=nodes)
