"""How far a calibrated rig can be trusted, in length units in the volume."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate._ray_miss import predicted_squares, ray_miss, views
from rigs.calibrate.bundle import Freedom, Scene, Sightings, adjust, information, predicted
from rigs.calibrate.initial import image_rows
from rigs.rig import Rig, Volume

__all__ = ["Quality", "covariance_of", "judged_points", "measure", "ray_miss"]

_GRID = 9  # points a side of the box that is judged
_COVERAGE_CELLS = 8  # along each side of an image
_SINGULAR = 1e-13  # least eigenvalue of the normal equations, scaled to a unit diagonal


@dataclass(frozen=True, eq=False)
class Quality:
    """Figures of a calibration; lengths in the rig's unit, in the volume.

    Parameters
    ----------
    points : (points, 3) float64
        Where ray-miss is judged: those of a grid that two cameras see.
    predicted_ray_miss : float
        RMS over points and rays, from the covariance; NaN for one camera.
    camera_ray_miss : (cameras,) float64
        The same for each camera's rays.
    point_ray_miss : (points,) float64
        The same for each point's rays.
    cross_ray_miss : float
        Ray-miss between the rigs of every other frame and of the rest; NaN where halves do not
        suffice. Halves know half as much, and two of them differ: twice ``predicted_ray_miss``
        is usual.
    cross_expected : float
        What the covariances of both halves predict for it.
    footprint : (cameras,) float64
        Pixel size in the middle of the points.
    image_rms : (cameras, frames) float64
        RMS length of the residuals of each image, left out or not, in pixels; NaN where none.
    alone_rms : (cameras, frames) float64
        The same when the target may stand as suits each camera alone; infinite where unknown.
    camera_rms : (cameras,) float64
        Of the sightings used.
    frame_rms : (frames,) float64
        Of the sightings used; NaN where none.
    image_coverage : (cameras,) float64
        Part of the image, in 8 x 8 cells, where the target was seen.
    depth_range : (cameras, 2) float64
        Nearest and farthest point seen, along the optical axis.
    focal_error : (cameras,) float64
        Standard deviation of the focal length relative to it; 0 where it was given.
    """

    points: NDArray[np.float64]
    predicted_ray_miss: float
    camera_ray_miss: NDArray[np.float64]
    point_ray_miss: NDArray[np.float64]
    cross_ray_miss: float
    cross_expected: float
    footprint: NDArray[np.float64]
    image_rms: NDArray[np.float64]
    alone_rms: NDArray[np.float64]
    camera_rms: NDArray[np.float64]
    frame_rms: NDArray[np.float64]
    image_coverage: NDArray[np.float64]
    depth_range: NDArray[np.float64]
    focal_error: NDArray[np.float64]


def measure(
    rig: Rig,
    scene: Scene,
    sightings: Sightings,
    used: NDArray[np.bool_],
    freedom: Freedom,
    alone_rms: NDArray[np.float64],
    volume: Volume | None,
) -> tuple[Quality, float, NDArray[np.float64]]:
    """Return the figures of an adjusted scene, the pixel noise and the covariance.

    Parameters
    ----------
    rig : Rig
        The cameras of ``scene``.
    scene : Scene
    sightings : Sightings
        In order of camera, then frame.
    used : (sightings,) bool
    freedom : Freedom
    alone_rms : (cameras, frames) float64
        As in `Quality`.
    volume : Volume, optional
        What is judged; by default where the target was.

    Raises
    ------
    ValueError
        Naming camera and parameter, if the sightings do not determine the cameras.
    """
    noise, covariance = covariance_of(rig, scene, sightings.where(used), freedom)
    points, seen = judged_points(rig, scene, sightings.where(used), volume)
    squares = np.zeros(seen.shape)
    cross, expected = np.nan, np.nan
    if len(points):
        squares = predicted_squares(scene, freedom, covariance, points, seen)
        cross, expected = _cross_validated(rig, scene, sightings.where(used), freedom, points)
    cameras, frames = len(rig), len(scene.target_t)
    residuals = sightings.uv - predicted(scene, sightings)
    lengths2 = (residuals**2).sum(axis=1)
    image_rms = np.full((cameras, frames), np.nan)
    for camera, frame, rows in image_rows(sightings):
        image_rms[camera, frame] = np.sqrt(lengths2[rows].mean())
    coverage, depths = np.zeros(cameras), np.full((cameras, 2), np.nan)
    for camera in range(cameras):
        own = sightings.where(used & (sightings.camera == camera))
        coverage[camera] = _coverage(own.uv, rig[camera].image_size)
        depth = _depths(scene, own, camera)
        depths[camera] = depth.min(initial=np.inf), depth.max(initial=-np.inf)
    middle = points.mean(axis=0) if len(points) else scene.target_t[sightings.frame[0]]
    quality = Quality(
        points,
        float(_rms(squares, seen, (0, 1))),
        _rms(squares, seen, 1),
        _rms(squares, seen, 0),
        cross,
        expected,
        rig.footprint(middle),
        image_rms,
        alone_rms,
        _group_rms(lengths2, sightings.camera, used, cameras),
        _group_rms(lengths2, sightings.frame, used, frames),
        coverage,
        depths,
        _focal_errors(scene, freedom, covariance),
    )
    return quality, noise, covariance


def covariance_of(
    rig: Rig, scene: Scene, sightings: Sightings, freedom: Freedom
) -> tuple[float, NDArray[np.float64]]:
    """Return the pixel noise and the covariance of the cameras' free parameters ``(P, P)``.

    Raises
    ------
    ValueError
        Naming the camera and the parameter least known, if they are not determined.
    """
    matrix, _ = information(scene, sightings, freedom)
    residuals = sightings.uv - predicted(scene, sightings)
    unknowns = len(matrix) + 6 * len(np.unique(sightings.frame))
    if residuals.size <= unknowns:
        raise ValueError(
            f"observations: found {residuals.size} coordinates, expected more than the "
            f"{unknowns} unknowns of cameras and target poses"
        )
    variance = float((residuals**2).sum()) / (residuals.size - unknowns)
    if not len(matrix):
        return float(np.sqrt(variance)), matrix
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    if values[0] < _SINGULAR * values[-1]:
        weakest = int(np.argmax(np.abs(vectors[:, 0])))
        camera, name = labels(rig.names, freedom)[weakest]
        raise ValueError(
            f"camera {camera}: {name} is not determined by the sightings, expected the target "
            "tilted in different directions, all over the image, and shared by cameras"
        )
    inverse = (vectors / values) @ vectors.T
    return float(np.sqrt(variance)), variance * inverse * np.outer(scale, scale)


def labels(names: tuple[str, ...], freedom: Freedom) -> tuple[tuple[str, str], ...]:
    """Return camera and name of each free parameter."""
    found = []
    for camera, name in enumerate(names):
        own = ["wx", "wy", "wz", "tx", "ty", "tz", "fx", "fy", "cx", "cy"]
        own += [f"c{i}" for i in range(len(freedom.lens[camera]) - 4)]
        free = freedom.columns(camera)
        found += [(name, label) for label, is_free in zip(own, free, strict=True) if is_free]
    return tuple(found)


def judged_points(
    rig: Rig, scene: Scene, sightings: Sightings, volume: Volume | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return points of the volume that two cameras see, and which cameras see them.

    Without a volume: a grid in the convex hull of all places where the target was seen.

    Returns
    -------
    points : (points, 3) float64
    seen : (cameras, points) bool
    """
    if len(rig) < 2:
        return np.zeros((0, 3)), np.zeros((len(rig), 0), bool)
    if volume is not None:
        corners = volume.corners()
        points = _box_grid(corners.min(axis=0), corners.max(axis=0))
    else:
        points = _swept(scene, sightings)
    seen = views(rig, points)
    good = seen.sum(axis=0) > 1
    if volume is not None and not good.any():
        raise ValueError("volume: found no point of it that two cameras see")
    return points[good], seen[:, good]


def _swept(scene: Scene, sightings: Sightings) -> NDArray[np.float64]:
    """Return a grid in the convex hull of the target's points, or these where they are flat."""
    from scipy.spatial import Delaunay, QhullError

    frames = sightings.frame
    places = np.einsum("nij,nj->ni", scene.target_R[frames], sightings.points)
    places += scene.target_t[frames]
    grid = _box_grid(places.min(axis=0), places.max(axis=0))
    try:
        inside = Delaunay(places[:: max(1, len(places) // 3000)]).find_simplex(grid) >= 0
    except QhullError:
        inside = np.zeros(len(grid), bool)
    return grid[inside] if inside.any() else places[:: max(1, len(places) // 300)]


def _box_grid(lower: NDArray, upper: NDArray) -> NDArray[np.float64]:
    """Return the points of a grid over a box, its faces included."""
    axes = [np.linspace(a, b, _GRID) for a, b in zip(lower, upper, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _cross_validated(
    rig: Rig, scene: Scene, sightings: Sightings, freedom: Freedom, points: NDArray
) -> tuple[float, float]:
    """Return the ray-miss between the rigs of both halves of the frames, and its expectation."""
    frames = np.unique(sightings.frame)
    halves, expected = [], 0.0
    for start in range(2):
        half = sightings.where(np.isin(sightings.frame, frames[start::2]))
        if not np.array_equal(np.unique(half.camera), np.arange(len(rig))):
            return np.nan, np.nan
        try:
            adjusted = adjust(scene, half, freedom, tolerance=1e-6).scene
            _, covariance = covariance_of(rig, adjusted, half, freedom)
            half_rig = with_scene(rig, adjusted)
        except ValueError:  # a half may be too little for what the whole determines
            return np.nan, np.nan
        seen = views(rig, points)
        squares = predicted_squares(adjusted, freedom, covariance, points, seen)
        expected += float(_rms(squares, seen, (0, 1))) ** 2
        halves.append(half_rig)
    return ray_miss(*halves, points), float(np.sqrt(expected))


def with_scene(rig: Rig, scene: Scene) -> Rig:
    """Return the rig with the lenses and poses of the scene."""
    cameras = []
    for camera, lens, R, t in zip(rig, scene.lenses, scene.camera_R, scene.camera_t, strict=True):
        cameras.append(
            replace(camera, camera_matrix=lens.matrix, distortion=lens.distortion, R=R, t=t)
        )
    return replace(rig, cameras=tuple(cameras))


def _coverage(uv: NDArray, image_size: tuple[int, int]) -> float:
    """Return the part of an image's cells that hold some of ``uv``."""
    cells = np.floor((uv + 0.5) / image_size * _COVERAGE_CELLS).astype(int)
    cells = np.unique(np.clip(cells, 0, _COVERAGE_CELLS - 1), axis=0)
    return len(cells) / _COVERAGE_CELLS**2


def _depths(scene: Scene, sightings: Sightings, camera: int) -> NDArray[np.float64]:
    """Return the depths of one camera's sightings."""
    frames = sightings.frame
    places = np.einsum("nij,nj->ni", scene.target_R[frames], sightings.points)
    return (places + scene.target_t[frames]) @ scene.camera_R[camera][2] + scene.camera_t[
        camera, 2
    ]


def _rms(squares: NDArray, seen: NDArray, axis: int | tuple[int, ...]) -> NDArray[np.float64]:
    """Return the root of the mean of ``squares`` where ``seen``; NaN where nothing is."""
    count = seen.sum(axis=axis)
    total = np.where(seen, squares, 0.0).sum(axis=axis)
    return np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _group_rms(squares: NDArray, group: NDArray, used: NDArray, count: int) -> NDArray[np.float64]:
    """Return the root mean of the used ``squares`` of each group; NaN where none."""
    number = np.bincount(group[used], minlength=count)
    total = np.bincount(group[used], squares[used], count)
    return np.sqrt(np.where(number > 0, total / np.maximum(number, 1), np.nan))


def _focal_errors(scene: Scene, freedom: Freedom, covariance: NDArray) -> NDArray[np.float64]:
    """Return the larger relative standard deviation of each camera's two focal lengths."""
    errors = np.zeros(len(scene.lenses))
    for camera, own in enumerate(freedom.slices):
        free = freedom.columns(camera)
        for place in (6, 7):
            if free[place]:
                at = own.start + int(free[:place].sum())
                focal = scene.lenses[camera].matrix[place - 6, place - 6]
                errors[camera] = max(errors[camera], np.sqrt(covariance[at, at]) / focal)
    return errors
