"""The unknowns of a joint solve: voxels where products are computed, parameters of NumPy's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import as_type, namespace
from tomo._compute.reductions import dot


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
