"""The unknowns of a joint solve, and the columns of its parameters.

Parameters are few and NumPy's; voxels and pixels may be arrays on a device. There all views are
summed at once: the pixels of each lie one below the other in a box as high as the largest view.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import as_type, is_numpy, like, namespace, taken, zeros
from tomo._compute.reductions import dot, total


class Unknowns(NamedTuple):
    """Voxels, voxels around the grid, parameters of the views, those that views share, a field.

    Each frame has its own voxels; the others are common to all frames. Parameters are in standard
    deviations of their priors.
    """

    voxels: Any  # (frames, unknowns) float64
    outside: Any  # (frames, outside unknowns) float64
    own: NDArray[np.float64]  # (parameters, views)
    shared: NDArray[np.float64]  # (parameters,)
    nodes: NDArray[np.float64]  # (nodes,), of the field

    def plus(self, step: float, other: Unknowns) -> Unknowns:
        """Return the sum with ``step`` times another."""
        return Unknowns(*(a + step * b for a, b in zip(self, other, strict=True)))

    def dot(self, other: Unknowns) -> float:
        """Return the inner product."""
        return sum(dot(a, b) for a, b in zip(self, other, strict=True))


def stacked(each: Sequence[Any]) -> Any:
    """Return vectors of all frames one below the other, ``(frames, n)``."""
    return namespace(each[0]).stack(tuple(each))


def rows_of(values: Any) -> list[Any]:
    """Return the vectors of each frame."""
    return [values[frame, ...] for frame in range(values.shape[0])]


def goes_below(values: Any) -> bool:
    """Return whether any value is negative."""
    return bool(namespace(values).any(values < 0))


def summed(each: Sequence[Unknowns]) -> Unknowns:
    """Return the voxels of every frame, and the sums of their parameters."""
    return Unknowns(
        stacked([one.voxels for one in each]),
        stacked([one.outside for one in each]),
        np.sum([one.own for one in each], axis=0),
        np.sum([one.shared for one in each], axis=0),
        np.sum([one.nodes for one in each], axis=0),
    )


def free_of(z: Unknowns, downhill: Unknowns) -> Unknowns:
    """Return 1 for what may change: what is above zero, or would rise."""

    def may(own: Any, down: Any) -> Any:
        return as_type(~((own <= 0) & (down <= 0)), np.float64)

    return Unknowns(
        may(z.voxels, downhill.voxels),
        may(z.outside, downhill.outside),
        np.ones_like(z.own),
        np.ones_like(z.shared),
        may(z.nodes, downhill.nodes),
    )


def feasible(z: Unknowns) -> Unknowns:
    """Return the nearest unknowns of which no voxel and no node is below zero."""
    above = (namespace(own).maximum(own, 0.0) for own in (z.voxels, z.outside, z.nodes))
    voxels, outside, nodes = above
    return z._replace(voxels=voxels, outside=outside, nodes=nodes)


class OwnColumns:
    """Columns ``T`` of the parameters that each view has for itself.

    ``values`` (k, pixels) have a column a parameter, of all views: those of each are zero at
    the pixels of others. ``weights`` (pixels,) are ``W``; products are computed where these
    are.
    """

    def __init__(self, values: NDArray[np.float64], view_ptr: NDArray, weights: Any) -> None:
        self.values, self.weights = values, weights
        self.ptr = view_ptr
        self._views = [slice(*ends) for ends in pairwise(view_ptr)]

    def forward(self, parameters: NDArray[np.float64]) -> Any:
        """Return ``T t``, ``(pixels,)``, of parameters ``(k, views)``."""
        if not is_numpy(self.weights):
            box, place, columns = self._box[0], self._box[2], like(parameters, self.weights)
            found = sum(box[:, k, :] * columns[k, :] for k in range(len(self.values)))
            return taken(namespace(found).reshape(found, (-1,)), place)
        found = np.zeros(len(self.weights))
        for view, rows in enumerate(self._views):
            found[rows] = np.einsum("kp,k->p", self.values[:, rows], parameters[:, view])
        return found

    def adjoint(self, pixels: Any) -> NDArray[np.float64]:
        """Return ``T^T p``, ``(k, views)``, of ``(pixels,)``."""
        if not is_numpy(self.weights):
            return self._sums(self._boxed(pixels))
        found = np.zeros((len(self.values), len(self._views)))
        for view, own in enumerate(self._views if len(self.values) else ()):
            found[:, view] = np.einsum("kp,p->k", self.values[:, own], pixels[own])
        return found

    def gram(self) -> NDArray[np.float64]:
        """Return ``T^T W T`` of each view, ``(views, k, k)``."""
        found = np.zeros((len(self._views), len(self.values), len(self.values)))
        for n, column in enumerate(self.values):
            if is_numpy(self.weights):
                found[:, n] = self.adjoint(self.weights * column).T
            else:
                found[:, n] = self._sums(self._box[0][:, n, :] * self._boxed(self.weights)).T
        return found

    @cached_property
    def _box(self) -> tuple[Any, NDArray[np.int64], NDArray[np.int64]]:
        """The columns ``(rows, k, views)``; the pixel of each place, and the place of each pixel.

        The number of pixels stands for places that have none.
        """
        counts, pixels = np.diff(self.ptr), self.values.shape[1]
        row = np.arange(counts.max(initial=0))[:, None]
        pixel = np.where(row < counts, self.ptr[:-1] + row, pixels)  # (rows, views)
        place = np.flatnonzero(pixel.ravel() < pixels)
        place = place[np.argsort(pixel.ravel()[place])]
        padded = np.pad(self.values, ((0, 0), (0, 1)))
        box = np.ascontiguousarray(np.moveaxis(padded[:, pixel], 0, 1))
        return like(box, self.weights), pixel, place

    def _boxed(self, pixels: Any) -> Any:
        """Return pixels in the box, ``(rows, views)``, zero where there are none."""
        xp, numbers = namespace(pixels), self._box[1]
        padded = xp.concat([pixels, zeros((1,), pixels)])
        return xp.reshape(taken(padded, numbers.ravel()), numbers.shape)

    def _sums(self, boxed: Any) -> NDArray[np.float64]:
        """Return the sums over each view of all columns times what is in the box."""
        products = self._box[0] * boxed[:, None, :]
        rows, *shape = products.shape
        flat = namespace(products).reshape(products, (rows, -1))
        return np.reshape(total(flat), shape)


class SharedColumns:
    """Columns of the parameters that all views share, as `OwnColumns`."""

    def __init__(self, values: NDArray[np.float64], weights: Any) -> None:
        self.values, self.weights = values, weights
        self._columns = [like(one, weights) for one in values]

    def added(self, pixels: Any, parameters: NDArray[np.float64]) -> Any:
        """Return ``p + T t``, ``(pixels,)``, of parameters ``(k,)``."""
        for column, value in zip(self._columns, parameters.tolist(), strict=True):
            pixels = pixels + column * value
        return pixels

    def adjoint(self, pixels: Any) -> NDArray[np.float64]:
        """Return ``T^T p``, ``(k,)``, of ``(pixels,)``."""
        if is_numpy(pixels):
            return np.einsum("kp,p->k", self.values, pixels)
        return np.array([dot(column, pixels) for column in self._columns], np.float64)

    def gram(self) -> NDArray[np.float64]:
        """Return ``T^T W T``, ``(k, k)``."""
        if is_numpy(self.weights):
            return np.einsum("kp,p,lp->kl", self.values, self.weights, self.values)
        found = [self.adjoint(self.weights * column) for column in self._columns]
        return np.array(found, np.float64).reshape(len(found), len(found))
