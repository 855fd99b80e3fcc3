"""Trace with Open3D's RaycastingScene: intersect rays with the planes between voxels.

Open3D says which planes a ray pierces; how far away each is follows in float64 from the plane's
number. Its rays are single precision, so three things are done for them: rays start just outside
the box instead of at the camera, in voxel units relative to the grid's middle; the planes overhang
the box, so that no ray slips past an edge; and a ray whose number of crossings is not what its
ends demand (it grazes a plane within single precision) is cut at every plane in float64.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.rays.ray_box import BoxCrossing, enter_box
from tomo.trace.segments import Segments, collect_by_pixel

if TYPE_CHECKING:
    import open3d

logger = logging.getLogger(__name__)

CUTS_AT_ONCE = 2_000_000
"""Rays times planes at once: bounds the working memory to some 100 MB."""
OVERHANG = 2.0
"""Voxels by which the planes reach beyond the box: without, rays slip past its edges."""
NEAR = 1e-6
"""Voxels from a ray's end to a plane below which the ray is cut in float64 alone."""


def plane_quads(shape: tuple[int, int, int]) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return the planes between voxels as two triangles each: vertices (V, 3), triangles (T, 3).

    Voxel units relative to the grid's middle; plane ``k`` owns triangles ``2 k`` and ``2 k + 1``;
    the planes are numbered along x, then y, then z. The outer faces are left out: where a ray
    enters and leaves the box is known in float64 already.
    """
    half = np.asarray(shape, np.float64) / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    quads = []
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        quad = np.zeros((shape[axis] - 1, 4, 3))
        quad[:, :, axis] = (np.arange(1, shape[axis]) - half[axis])[:, None]
        quad[:, :, others] = corners * (half[others] + OVERHANG)
        quads.append(quad)
    vertices = np.concatenate(quads).reshape(-1, 3)
    first = 4 * np.arange(len(vertices) // 4)[:, None]
    triangles = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    return vertices.astype(np.float32), triangles.astype(np.uint32)


def _cuts(
    scene: open3d.t.geometry.RaycastingScene, box: BoxCrossing, shape: tuple[int, int, int]
) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Return where every ray is cut, sorted, and the axis of the plane that cuts it.

    Both (rays, planes + 2), from the entry at 0 to the ray's length; ends have axis -1. Planes
    that a ray does not pierce inside the box stand at its length: segments of no length.
    """
    import open3d

    norm = np.linalg.norm(box.direction, axis=1, keepdims=True)
    unit = box.direction / np.where(norm == 0, 1.0, norm)  # zero: too short to move at all
    start = box.position - unit - np.asarray(shape) / 2  # one voxel outside
    lines = np.concatenate([start, unit], axis=1).astype(np.float32)
    hits = scene.list_intersections(open3d.core.Tensor.from_numpy(lines))
    axis = np.repeat(np.arange(3), [n - 1 for n in shape])  # of each plane
    coordinate = np.concatenate([np.arange(1, n) for n in shape])
    pierced = np.zeros((len(unit), len(axis)), bool)  # a diagonal's second hit changes nothing
    pierced[hits["ray_ids"].numpy(), hits["primitive_ids"].numpy() // 2] = True

    along = box.direction[:, axis]  # (rays, planes)
    parallel = along == 0
    with np.errstate(over="ignore"):
        distance = (coordinate - box.position[:, axis]) / np.where(parallel, 1.0, along)
    end = box.length[:, None]
    inside = ~parallel & (distance > 0) & (distance < end)
    doubtful = (pierced & inside).sum(axis=1) != box.planes_between(shape)
    doubtful |= _ends_near_plane(box, shape)
    pierced[doubtful] = True
    if doubtful.any():
        logger.debug("%d of %d rays were cut in float64 alone", doubtful.sum(), len(unit))
    cuts = np.concatenate([np.zeros_like(end), np.where(pierced & inside, distance, end), end], 1)
    order = np.argsort(cuts, axis=1, kind="stable")
    axis = np.concatenate([[-1], axis, [-1]]).astype(np.int8)
    return np.take_along_axis(cuts, order, axis=1), axis[order]


def _ends_near_plane(box: BoxCrossing, shape: tuple[int, int, int]) -> NDArray[np.bool_]:
    """Say of each ray whether rounding would decide if the plane at one of its ends counts."""
    ends = np.stack([box.position, box.position + box.direction * box.length[:, None]])
    ends = np.clip(ends, 0, shape)
    plane = np.round(ends)
    near = (np.abs(ends - plane) < NEAR) & (plane > 0) & (plane < shape)
    return near.any(axis=(0, 2))


def trace(
    rays: Rays, grid: VoxelGrid, *, midpoints: bool = False, dtype: DTypeLike = np.float32
) -> Segments:
    """Trace rays through Open3D; see `tomo.trace.trace`.

    Raises
    ------
    ImportError
        Where Open3D or one of its system libraries is missing.
    """
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    vertices, triangles = plane_quads(grid.shape)
    if len(triangles) == 0:  # a single voxel: Open3D refuses an empty mesh
        vertices = np.full((3, 3), 2.0 * OVERHANG, np.float32)
        triangles = np.array([[0, 1, 2]], np.uint32)
    scene.add_triangles(
        open3d.core.Tensor.from_numpy(vertices), open3d.core.Tensor.from_numpy(triangles)
    )

    whole = enter_box(rays, grid)
    crossing = np.flatnonzero(whole.length > 0)
    counts = np.zeros(len(rays), np.int64)
    lengths, indices, middles = [np.zeros(0)], [np.zeros((0, 3), np.int64)], [np.zeros((0, 3))]
    at_once = max(CUTS_AT_ONCE // sum(grid.shape), 1)
    for first in range(0, len(crossing), at_once):
        some = crossing[first : first + at_once]
        box = BoxCrossing(whole.position[some], whole.direction[some], whole.length[some])
        cuts, axis = _cuts(scene, box, grid.shape)
        piece = np.diff(cuts, axis=1)
        ray, slot = np.nonzero(piece > 0)
        counts[some] = np.bincount(ray, minlength=len(some))
        piece = piece[ray, slot]
        middle = cuts[ray, slot] + piece / 2
        lengths.append(piece)
        passed = [np.cumsum(axis == a, axis=1)[ray, slot] for a in range(3)]  # planes of each axis
        step = np.sign(box.direction).astype(np.int64)
        first_voxel = box.first_voxel(grid.shape)
        indices.append(first_voxel[ray] + step[ray] * np.stack(passed, axis=1))
        middles.append(box.position[ray] + box.direction[ray] * middle[:, None])
    return collect_by_pixel(
        rays, grid, counts, np.concatenate(lengths), np.concatenate(indices),
        np.concatenate(middles), midpoints=midpoints, dtype=dtype,
    )  # fmt: skip
