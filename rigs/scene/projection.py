"""The pixel whose path passes through a point: the inverse of tracing, by Newton's method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import CameraLike
from rigs.geometry.image_checks import on_image
from rigs.ray_table.interpolation import CLOSE, DEPTHS, STEPS
from rigs.scene.paths import Paths
from rigs.scene.scene import Scene

_NODES = 33  # start rays along each side of the image; fewer may miss a mirror
_STARTS = 4  # of the nearest start points, tried one after another
_BEYOND = 0.1  # fraction of the image beyond its border in which points are found
_GOOD = 1e-6  # pixels; at the edge of a solid Newton's method stays further off
_APART = 1e-3  # pixels between the rays of a difference: error 1e-6 of a step, rounding 1e-10


def pixels_that_pass(
    camera: CameraLike, scene: Scene, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the pixels ``(N, 2)`` whose paths pass through points; NaN where none does.

    Newton's method solves for the pixel at which the path's piece nearest to the point misses it
    by nothing. It starts from the projection of the ``camera`` without the scene, which windows
    move by few pixels, then from the nearest points on paths all over the image, which mirrors
    need. Of several images of a point one on the image goes before those beyond its border.
    """
    found = np.full((len(points), 2), np.nan)
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(finite):
        return found
    straight, _, ahead = camera.project(points[finite])
    found[finite[ahead]] = _newton(camera, scene, points[finite[ahead]], straight[ahead])
    waiting = finite[np.isnan(found[finite, 0])]
    if scene.has_mirrors:  # what is beyond the image directly may be on it by a mirror
        waiting = finite[~on_image(found[finite], camera.image_size)]
    if len(waiting):
        other = _from_lattice(camera, scene, points[waiting])
        better = on_image(other, camera.image_size) | np.isnan(found[waiting, 0])
        found[waiting[better]] = other[better]
    return found


def _from_lattice(
    camera: CameraLike, scene: Scene, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return pixels ``(N, 2)``, started from paths all over the image."""
    from scipy.spatial import cKDTree

    found = np.full((len(points), 2), np.nan)
    axes = [np.linspace(-_BEYOND, 1 + _BEYOND, _NODES) * (side - 1) for side in camera.image_size]
    lattice = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    origins, directions = camera.rays(lattice)
    known = np.isfinite(directions).all(axis=1)
    if not known.any():
        return found
    paths = scene.paths(origins[known], directions[known])
    pixels = lattice[known].repeat(np.diff(paths.ray_ptr), axis=0)
    nodes = _points_along(paths, points)  # (pieces, depths, 3)
    tree = cKDTree(nodes.reshape(-1, 3))
    starts = min(_STARTS, tree.n)
    nearest = tree.query(points, k=[*range(1, starts + 1)])[1] // DEPTHS  # (N, starts)
    waiting = np.arange(len(points))
    for attempt in range(starts):
        start = pixels[nearest[waiting, attempt]]
        found[waiting] = _newton(camera, scene, points[waiting], start)
        waiting = waiting[np.isnan(found[waiting, 0])]
        if not len(waiting):
            break
    return found


def _points_along(paths: Paths, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points on every piece, as far ahead as ``points`` lie: ``(pieces, depths, 3)``."""
    middle = points.mean(axis=0)
    reach = float(np.linalg.norm(points - middle, axis=1).max())
    along = np.einsum("ij,ij->i", middle - paths.origins, paths.directions)
    first = np.clip(along - reach, 0, paths.lengths)
    last = np.clip(along + reach, 0, paths.lengths)
    steps = np.linspace(first, last, DEPTHS, axis=1)[..., None]
    return paths.origins[:, None] + steps * paths.directions[:, None]


def _newton(
    camera: CameraLike, scene: Scene, points: NDArray[np.float64], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the pixels ``(N, 2)`` from ``start``, NaN where no path near it passes the point."""
    size = np.array(camera.image_size, np.float64)
    uv, moved = start.copy(), np.full(len(points), np.inf)
    passes = np.zeros(len(points), bool)
    active = np.arange(len(points))
    for _ in range(STEPS):
        missed, on_piece = _missed(camera, scene, points[active], uv[active])  # (n, 3, 3)
        right, down = (
            (missed[:, 1] - missed[:, 0]) / _APART,
            (missed[:, 2] - missed[:, 0]) / _APART,
        )
        step = _least_squares(right, down, -missed[:, 0])
        step = np.clip(step, -size / 4, size / 4)
        uv[active] += step
        passes[active] = on_piece
        moved[active] = np.abs(step).max(axis=1)
        outside = (np.abs(uv[active] - (size - 1) / 2) > (0.5 + 2 * _BEYOND) * size).any(axis=1)
        active = active[(moved[active] > CLOSE) & ~outside]  # NaN ends too
        if not len(active):
            break
    good = (moved <= _GOOD) & passes
    return np.where(good[:, None], uv, np.nan)


def _missed(
    camera: CameraLike, scene: Scene, points: NDArray[np.float64], uv: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return by which vectors ``(N, 3, 3)`` the paths of pixels and two neighbours miss points.

    NaN where the lens has no ray; and whether the pixel's piece itself, not its extension, passes.
    """
    stencil = uv[:, None] + np.array([[0, 0], [_APART, 0], [0, _APART]])  # (N, 3, 2)
    origins, directions = camera.rays(stencil.reshape(-1, 2))
    known = np.isfinite(directions).all(axis=1)
    missed = np.full((3 * len(points), 3), np.nan)
    on_piece = np.zeros(3 * len(points), bool)
    aims = points.repeat(3, axis=0)[known]
    paths = scene.paths(origins[known], directions[known])
    piece = paths.nearest_pieces(aims)
    away, ahead = aims - paths.origins[piece], paths.directions[piece]
    along = np.einsum("ij,ij->i", away, ahead)
    missed[known] = away - along[:, None] * ahead
    on_piece[known] = (along >= 0) & (along <= paths.lengths[piece])
    return missed.reshape(-1, 3, 3), on_piece[::3]


def _least_squares(
    right: NDArray[np.float64], down: NDArray[np.float64], aim: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the steps ``(N, 2)`` a, b with the least ``|a right + b down - aim|``, or NaN."""
    aa, ab, bb = ((x * y).sum(axis=1) for x, y in ((right, right), (right, down), (down, down)))
    a, b = (right * aim).sum(axis=1), (down * aim).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([bb * a - ab * b, aa * b - ab * a], axis=1) / (aa * bb - ab**2)[:, None]
