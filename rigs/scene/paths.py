"""Lines of sight through a scene: straight pieces, one behind the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.scene.mesh import Mesh
from rigs.scene.tracing import PIECE, RAY, follow, write_pieces

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
    boxes = np.array([mesh.box for _, mesh in meshes]).reshape(-1, 2, 3)
    pieces = np.zeros((MOST_FACES + 1, min(AT_ONCE, len(origins))), PIECE)
    counts, ends = np.zeros(len(origins), np.int64), np.zeros(len(origins), np.int64)
    columns, total = _columns(0), 0
    for first in range(0, len(origins), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        rays = np.zeros(len(origins[some]), RAY)
        rays["origin"], rays["direction"] = origins[some], directions[some]
        rays["index"], rays["weight"], rays["last"] = medium, 1.0, -1
        _follow_to_ends(rays, pieces, faces, meshes, boxes, fresnel)
        counts[some], ends[some] = rays["pieces"], rays["end"]
        starts = total + np.cumsum(rays["pieces"]) - rays["pieces"]
        total += int(rays["pieces"].sum())
        if total > len(columns[0]):
            columns = _grown(columns, total * len(origins) // (first + len(rays)) + total // 16)
        write_pieces(rays, pieces, starts, columns)
    ray_ptr = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
    return Paths(*(column[:total] for column in columns), ray_ptr, ends)


def _columns(length: int) -> tuple[NDArray, ...]:
    """Return the columns of `Paths` for that many pieces: zeros."""
    shapes = (length, 3), (length, 3), length, length
    return *(np.zeros(shape) for shape in shapes), np.zeros(length, np.int64)


def _grown(columns: tuple[NDArray, ...], length: int) -> tuple[NDArray, ...]:
    """Return longer columns that begin with those given."""
    longer = _columns(length)
    for new, old in zip(longer, columns, strict=True):
        new[: len(old)] = old
    return longer


def _follow_to_ends(
    rays: NDArray,
    pieces: NDArray,
    faces: NDArray,
    meshes: list[tuple[int, Mesh]],
    boxes: NDArray[np.float64],
    fresnel: bool,
) -> None:
    """Follow rays (`rigs.scene.tracing.RAY`) to their ends, and write their pieces."""
    active, waiting = np.arange(len(rays)), np.zeros(len(rays), np.int64)
    while True:
        count = follow(active, rays, pieces, faces, boxes, fresnel, waiting)
        if not count:
            return
        active = waiting[:count].copy()
        asking = rays[active]
        for row, mesh in meshes:
            met, distance, normal = mesh.nearest(
                asking["origin"], asking["direction"], asking["last"] == row, asking["length"]
            )
            asking["length"][met], asking["face"][met] = distance, row
            asking["normal"][met] = normal
        asking["asked"] = True
        rays[active] = asking
