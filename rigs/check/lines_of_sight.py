"""Lines of sight: the angles between them, and ray-miss, their distance from a common point."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera_protocol import CameraLike
from rigs.rig import Rig


def ray_distances(true: Rig, estimated: Rig, points: ArrayLike) -> NDArray[np.float64]:
    """Return the distances of an estimated rig's rays from their best common points, ``(C, N)``.

    Points ``(N, 3)`` are projected with the true cameras; rays through these pixels are those of
    the estimated cameras of the same names, in any world: a common motion changes nothing.
    Distances are in the estimated rig's unit; NaN where the camera does not see the point or fewer
    than two do.
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
    misses = np.einsum("ncij,ncj->nci", across, nearest - origins)
    return np.where(there, np.linalg.norm(misses, axis=2), np.nan).T


def ray_miss(true: Rig, estimated: Rig, points: ArrayLike) -> float:
    """Return the RMS of `ray_distances`, a rig's figure of merit; NaN where none is finite."""
    return finite_rms(ray_distances(true, estimated, points))


def finite_rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square of the finite values; NaN without any."""
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def expected_ray_miss(
    directions: NDArray[np.float64], error: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the expected ray-miss ``(N,)`` of lines along ``directions`` ``(N, C, 3)``.

    ``error`` ``(N, C)``: RMS displacement along each direction across a line; NaN without a line.
    """
    there = np.isfinite(error)
    variance = np.where(there, error, 0.0) ** 2  # (N, C)
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]  # (N, C, 3, 3)
    across = np.where(there[..., None, None], across, 0.0)
    inverse = np.linalg.pinv(across.sum(axis=1), rcond=1e-9, hermitian=True)
    weighted = (across * variance[..., None, None]).sum(axis=1)
    total = 2 * variance.sum(axis=1) - np.einsum("nij,nji->n", inverse, weighted)
    count = there.sum(axis=1)
    miss = np.sqrt(np.maximum(total, 0) / np.maximum(count, 1))
    return np.where(count >= 2, miss, np.nan)


def angles_between(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles in degrees, 0 to 90, between lines along ``(C, 3)``: ``(C, C)``.

    The diagonal is infinite, so that a row's minimum is the nearest other line.
    """
    lines = lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), 1e-300)
    # by sine and cosine: the arc cosine alone is inexact for nearly equal lines
    sine = np.linalg.norm(np.cross(lines[:, None], lines[None]), axis=2)
    angles = np.degrees(np.arctan2(sine, np.abs(lines @ lines.T)))
    np.fill_diagonal(angles, np.inf)
    return angles


def field_of_view(camera: CameraLike) -> float:
    """Return the angle in degrees between opposite corners' lines of sight, or NaN."""
    width, height = camera.image_size
    corners = np.array([[0, 0], [width, height], [width, 0], [0, height]]) - 0.5
    rays = camera.rays(corners)[1]
    cosines = [float(rays[0] @ rays[1]), float(rays[2] @ rays[3])]
    return float(np.degrees(np.arccos(np.clip(min(cosines), -1, 1))))
