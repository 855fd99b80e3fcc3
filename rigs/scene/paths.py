"""Lines of sight through a scene: straight pieces, one behind the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.scene.mesh import Mesh
from rigs.scene.tracing import OPEN, TRAPPED, meet, nearest_face

MOST_FACES = 50
"""Faces that a ray may meet: two mirrors that face each other would reflect it for ever."""

AT_ONCE = 8192
"""Rays that are followed together: their arrays then stay in a processor's cache."""


@dataclass(frozen=True, eq=False)
class Paths:
    """Rays as straight pieces; ray ``r`` owns the pieces ``ray_ptr[r]:ray_ptr[r + 1]``.

    Attributes
    ----------
    origins, directions : (N, 3) float64
        Start and unit direction of each piece, in world coordinates.
    lengths : (N,) float64
        Infinite for the last piece of a ray that nothing ends.
    weight : (N,) float64
        Fraction of the light emitted on the piece that reaches the camera.
    solids : (N,) int64
        Number of the solid that each piece ends at, -1 where nothing is ahead.
    ray_ptr : (rays + 1,) int64
        Where each ray's pieces begin.
    ends : (rays,) int64
        How each ray ends, as in `rigs.scene.tracing`.
    """

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]
    weight: NDArray[np.float64]
    solids: NDArray[np.int64]
    ray_ptr: NDArray[np.int64]
    ends: NDArray[np.int64]

    def __len__(self) -> int:
        """Return the number of rays."""
        return len(self.ends)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Paths: {len(self)} rays, {len(self.lengths)} pieces>"

    def nearest_pieces(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return for each ray the number of its piece that passes a point most closely.

        Parameters
        ----------
        points : (rays, 3) or (3,) float64
            One for each ray, or one for all; of pieces equally near the first is returned.
        """
        counts = np.diff(self.ray_ptr)
        away = np.broadcast_to(points, (len(self), 3)).repeat(counts, axis=0) - self.origins
        along = np.clip(np.einsum("ij,ij->i", away, self.directions), 0, self.lengths)
        missed = np.linalg.norm(away - along[:, None] * self.directions, axis=1)
        least = np.minimum.reduceat(missed, self.ray_ptr[:-1]) if len(missed) else missed
        is_least = missed == np.repeat(least, counts)
        first = np.maximum.accumulate(np.where(is_least[::-1], np.arange(len(missed)), -1))[::-1]
        return (len(missed) - 1 - first)[self.ray_ptr[:-1]]


def trace_paths(
    faces: NDArray,
    meshes: list[tuple[int, Mesh]],
    medium: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    *,
    fresnel: bool = False,
) -> Paths:
    """Return the paths of rays, all rays from face to face at once.

    Parameters
    ----------
    faces : (F,) `rigs.scene.surfaces.FACE`
    meshes : list of (int, Mesh)
        With the number of the row that stands for each.
    medium : float
        Index of the medium in which rays begin.
    origins, directions : (N, 3) float64
        Unit directions, finite.
    fresnel : bool
        Whether glass takes the fraction of light that it reflects.
    """
    blocks = [
        _trace_block(
            faces, meshes, medium, origins[first : first + AT_ONCE],
            directions[first : first + AT_ONCE], fresnel,
        )
        for first in range(0, max(len(origins), 1), AT_ONCE)
    ]  # fmt: skip
    *columns, counts, ends = (np.concatenate(column) for column in zip(*blocks, strict=True))
    return Paths(*columns, np.concatenate([[0], np.cumsum(counts)]), ends)


def _trace_block(
    faces: NDArray,
    meshes: list[tuple[int, Mesh]],
    medium: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    fresnel: bool,
) -> tuple[NDArray, ...]:
    """Return the columns of `Paths` of some rays, but the number of pieces of each ray."""
    count = len(origins)
    ray, last = np.arange(count), np.full(count, -1)
    origin, direction = origins.copy(), directions.copy()
    media = np.full((count, 2), (medium, 0.0))
    weight, ends = np.ones(count), np.full(count, OPEN)
    steps, counts, all_ends = [], np.zeros(count, np.int64), np.full(count, TRAPPED)
    for _ in range(MOST_FACES + 1):
        length, found, normal = np.full(len(ray), np.inf), last.copy(), np.zeros((len(ray), 3))
        nearest_face(origin, direction, last, faces, length, found)
        for row, mesh in meshes:
            met, distance, own = mesh.nearest(origin, direction, last == row, length)
            length[met], found[met], normal[met] = distance, row, own
        ahead = np.isfinite(length)
        solid = np.where(ahead, faces["solid"][found], -1)
        steps.append((ray, (origin.copy(), direction.copy(), length, weight.copy(), solid)))
        counts[ray] += 1
        meet(origin, direction, length, normal, found, faces, media, weight, fresnel, ends)
        goes_on = ahead & (ends == OPEN)
        all_ends[ray[~goes_on]] = ends[~goes_on]
        if not goes_on.any():
            break
        ray, origin, direction = ray[goes_on], origin[goes_on], direction[goes_on]
        last, media = found[goes_on], media[goes_on]
        weight, ends = weight[goes_on], ends[goes_on]
    first, total = np.cumsum(counts) - counts, int(counts.sum())
    columns = [np.zeros((total, *column.shape[1:]), column.dtype) for column in steps[0][1]]
    for number, (ray, own) in enumerate(steps):
        for column, values in zip(columns, own, strict=True):
            column[first[ray] + number] = values
    return *columns, counts, all_ends
