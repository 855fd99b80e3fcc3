"""Lines of sight against each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from rigs.rig import Rig


def nearest_point(
    positions: NDArray[np.float64], directions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the point with the least sum of squared distances to lines.

    The normal equations are ``sum_i (I - d_i d_i^T) (x - p_i) = 0``, solved about the mean
    position, so that parallel lines give a point beside the cameras.

    Parameters
    ----------
    positions : (N, 3) float64
        A point on each line.
    directions : (N, 3) float64
        Unit vectors along them.

    Returns
    -------
    point : (3,) float64
        That of least distance from the mean position where it is not unique.
    certainty : float
        The smallest eigenvalue of the equations: 0 for parallel lines, at most ``2 N / 3``.
    """
    middle = positions.mean(axis=0)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # (N, 3, 3)
    right = (across @ (positions - middle)[:, :, None]).sum(axis=0)[:, 0]
    offset, _, _, singular_values = np.linalg.lstsq(across.sum(axis=0), right, rcond=1e-9)
    return middle + offset, float(singular_values[-1])


def ray_distances(true: Rig, estimated: Rig, points: ArrayLike) -> NDArray[np.float64]:
    """Return how far an estimated rig's rays pass from the points they should meet in.

    Points are projected with the true cameras; their pixels are cast back with the estimated
    cameras of the same names.

    Parameters
    ----------
    true, estimated : Rig
        The estimated one in any world: a common displacement of its cameras changes nothing.
    points : (N, 3) array_like
        In the true rig's world.

    Returns
    -------
    (C, N) float64
        Of each camera's ray from the point nearest to all, in the estimated rig's length unit;
        NaN where the camera does not see the point or fewer than two do.

    Raises
    ------
    ValueError
        If the estimated rig lacks a camera.
    """
    points = np.asarray(points, np.float64).reshape(-1, 3)
    origins, directions = np.full((2, len(points), len(true), 3), np.nan)
    for number, camera in enumerate(true):
        uv, _, _ = camera.project(points)
        seen = camera.inside(uv)
        origins[seen, number], directions[seen, number] = estimated[camera.name].rays(uv[seen])
    there = np.isfinite(origins).all(axis=2) & np.isfinite(directions).all(axis=2)  # (N, C)
    there &= (there.sum(axis=1) > 1)[:, None]
    origins, directions = (np.where(there[..., None], a, 0.0) for a in (origins, directions))
    count = np.maximum(there.sum(axis=1), 1)[:, None, None]
    middle = origins.sum(axis=1, keepdims=True) / count
    across = (np.eye(3) - directions[..., :, None] * directions[..., None, :]) * there[
        ..., None, None
    ]
    right = np.einsum("ncij,ncj->ni", across, origins - middle)
    inverse = np.linalg.pinv(across.sum(axis=1), rcond=1e-9, hermitian=True)
    nearest = np.einsum("nij,nj->ni", inverse, right)[:, None] + middle
    off = np.einsum("ncij,ncj->nci", across, nearest - origins)
    return np.where(there, np.linalg.norm(off, axis=2), np.nan).T


def ray_miss(true: Rig, estimated: Rig, points: ArrayLike) -> float:
    """Return the RMS of `ray_distances`, the figure to judge a rig by; NaN where none is."""
    distances = ray_distances(true, estimated, points)
    squares = distances[np.isfinite(distances)] ** 2
    return float(np.sqrt(squares.mean())) if squares.size else float("nan")
