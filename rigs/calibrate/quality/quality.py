"""Figures of a calibrated rig's accuracy, in length units in the volume."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import adjust
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted
from rigs.calibrate.quality.covariance import covariance_of, focal_errors, lens_misfit
from rigs.calibrate.quality.ray_miss import (
    camera_accuracies,
    evaluation_points,
    predicted_squares,
    views,
)
from rigs.camera import Camera
from rigs.check.lines_of_sight import ray_miss
from rigs.figures import Accuracy
from rigs.rig import Rig, Volume

_COVERAGE_CELLS = 8  # along each side of an image
_LEAST_SPARE = 60  # degrees of freedom between images; fewer do not determine their variance
_HALVES_TOO_POOR = (
    6.0  # times the whole rig's ray-miss, beyond which halves are too poor to compare
)


@dataclass(frozen=True, eq=False)
class Quality:
    """Figures of a calibration; lengths in the rig's unit, in the volume.

    Parameters
    ----------
    points : (points, 3) float64
        Where ray-miss is evaluated: points of a grid that two cameras see.
    predicted_ray_miss : float
        RMS over points and rays, from the covariance; NaN for one camera. The noise is
        that between images where it exceeds that within them.
    camera_ray_miss : (cameras,) float64
        The same for each camera's rays.
    point_ray_miss : (points,) float64
        The same for each point's rays.
    cross_ray_miss : float
        Ray-miss between the rigs of every other frame and of the rest; NaN where halves do not
        suffice. Each half has half the data and both err: twice ``predicted_ray_miss`` is usual.
    cross_expected : float
        Its prediction from the covariances of both halves.
    footprint : (cameras,) float64
        Pixel size in the middle of the points.
    image_rms : (cameras, frames) float64
        RMS length of each image's residuals in pixels, outliers included; NaN without any.
    alone_rms : (cameras, frames) float64
        The same when each camera by itself decides the target's pose.
    contradiction : (cameras, frames) float64
        By how much the common target pose worsens an image's residuals, in standard deviations:
        ``sqrt((sum of squares - that alone) / 6) / noise alone``. About 1 when all is well,
        however noisy; NaN where there is no pose.
    camera_rms : (cameras,) float64
        RMS residual of each camera's used observations, pixels.
    frame_rms : (frames,) float64
        The same for each frame; NaN where none is used.
    image_coverage : (cameras,) float64
        Fraction of the image's 8 x 8 cells in which the target was seen.
    volume_coverage : (cameras,) float64
        The same among the cells in which the camera sees ``points``; NaN where it sees none.
    depth_range : (cameras, 2) float64
        Nearest and farthest point seen, along the optical axis.
    focal_error : (cameras,) float64
        Standard deviation of the focal length relative to it; 0 where it was given.
    lens_misfit : (cameras,) float64
        By how many standard deviations what is held of a lens does not fit; about 1 when it does,
        0 where nothing is held.
    accuracy : tuple of Accuracy or None
        How exactly each camera is known; see `camera_accuracies`.
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
    contradiction: NDArray[np.float64]
    camera_rms: NDArray[np.float64]
    frame_rms: NDArray[np.float64]
    image_coverage: NDArray[np.float64]
    volume_coverage: NDArray[np.float64]
    depth_range: NDArray[np.float64]
    focal_error: NDArray[np.float64]
    lens_misfit: NDArray[np.float64]
    accuracy: tuple[Accuracy | None, ...]


def measure(
    rig: Rig,
    scene: Scene,
    observations: ObservationArrays,
    used: NDArray[np.bool_],
    freedom: Freedom,
    volume: Volume | None,
) -> tuple[Quality, float, NDArray[np.float64]]:
    """Return the figures of an adjusted scene, the pixel noise and the covariance.

    Ray-miss is taken in the volume, by default where the target was.
    """
    noise, covariance = covariance_of(rig, scene, observations.where(used), freedom)
    image_rms, alone_rms, contradiction, excess = image_figures(scene, observations, used, freedom)
    covariance = covariance * excess
    points, seen = evaluation_points(rig, scene, observations.where(used), volume)
    squares = np.zeros(seen.shape)
    cross, expected = np.nan, np.nan
    accuracy: tuple[Accuracy | None, ...] = (None,) * len(rig)
    if len(points):
        accuracy = camera_accuracies(scene, freedom, covariance, points, seen)
        squares = predicted_squares(scene, freedom, covariance, points, seen)
        whole = float(_rms(squares, seen, (0, 1)))
        cross, expected = _cross_validated(
            rig, scene, observations.where(used), freedom, points, whole
        )
        expected *= float(np.sqrt(excess))
    cameras, frames = len(rig), len(scene.target_t)
    residuals = observations.uv - predicted(scene, observations)
    lengths2 = (residuals**2).sum(axis=1)
    coverage, depths = np.zeros((2, cameras)), np.full((cameras, 2), np.nan)
    for camera in range(cameras):
        own = observations.where(used & (observations.camera == camera))
        uv, _, _ = rig[camera].project(points[seen[camera]])
        coverage[:, camera] = _coverage(own.uv, uv, rig[camera].image_size)
        depth = _depths(scene, own, camera)
        depths[camera] = depth.min(initial=np.inf), depth.max(initial=-np.inf)
    middle = points.mean(axis=0) if len(points) else scene.target_t[observations.frame[0]]
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
        contradiction,
        _group_rms(lengths2, observations.camera, used, cameras),
        _group_rms(lengths2, observations.frame, used, frames),
        coverage[0],
        coverage[1],
        depths,
        focal_errors(scene, freedom, covariance / excess),
        lens_misfit(scene, observations.where(used), freedom, noise),
        accuracy,
    )
    return quality, noise, covariance


def _cross_validated(
    rig: Rig,
    scene: Scene,
    observations: ObservationArrays,
    freedom: Freedom,
    points: NDArray,
    whole: float,
) -> tuple[float, float]:
    """Return the ray-miss between the rigs of both halves of the frames, and its expectation.

    NaN where halves have too little data: far above the ``whole`` rig's.
    """
    frames = np.unique(observations.frame)
    halves, expected = [], 0.0
    for start in range(2):
        half = observations.where(np.isin(observations.frame, frames[start::2]))
        if not np.array_equal(np.unique(half.camera), np.arange(len(rig))):
            return np.nan, np.nan
        try:
            adjusted = adjust(scene, half, freedom, tolerance=1e-5).scene
            _, covariance = covariance_of(rig, adjusted, half, freedom)
            half_rig = with_scene(rig, adjusted)
        except ValueError:  # a half may not determine what the whole does
            return np.nan, np.nan
        seen = views(rig, points)
        squares = predicted_squares(adjusted, freedom, covariance, points, seen)
        expected += float(_rms(squares, seen, (0, 1))) ** 2
        halves.append(half_rig)
    if expected > (_HALVES_TOO_POOR * whole) ** 2:
        return np.nan, np.nan
    return ray_miss(halves[0], halves[1], points), float(np.sqrt(expected))


def with_scene(rig: Rig, scene: Scene) -> Rig:
    """Return the rig with the lenses and poses of the scene."""
    cameras = tuple(
        Camera(
            one.name, one.image_size, lens.matrix, lens.distortion, R, t, one.optics, one.status
        )
        for one, lens, R, t in zip(rig, scene.lenses, scene.camera_R, scene.camera_t, strict=True)
    )
    rig = replace(rig, cameras=cameras)
    return rig if scene.refraction is None else rig.through(scene.refraction.scene)


def image_figures(
    scene: Scene, observations: ObservationArrays, used: NDArray[np.bool_], freedom: Freedom
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
    """Return each image's RMS, that alone, and its contradiction, all ``(cameras, frames)``.

    Outliers in an image that is used do not count. The fourth value is the ratio of the variance
    between images to that within them, at least 1, as in an analysis of variance by groups: errors
    common to the points of one image do not average out over them.
    """
    shape = len(scene.lenses), len(scene.target_t)
    kept = np.zeros(shape, bool)
    kept[observations.camera[used], observations.frame[used]] = True
    residuals = observations.uv - predicted(scene, observations)
    shown = np.isfinite(residuals).all(axis=1)
    shown &= used | ~kept[observations.camera, observations.frame]
    observations, residuals = observations.where(shown), residuals[shown]
    images = observations.camera * shape[1] + observations.frame
    alone = adjust(
        replace(
            scene,
            target_R=np.tile(scene.target_R, (shape[0], 1, 1)),
            target_t=np.tile(scene.target_t, (shape[0], 1)),
        ),
        replace(observations, frame=images),
        Freedom(
            tuple(np.zeros(lens.size, bool) for lens in scene.lenses), np.zeros(shape[0], bool)
        ),
        iterations=10,
        tolerance=1e-6,
    )
    size = shape[0] * shape[1]
    number = np.bincount(images, minlength=size).reshape(shape)
    together, by_itself = (
        np.bincount(images, (r**2).sum(axis=1), size).reshape(shape)
        for r in (residuals, alone.residuals)
    )
    spare = np.where(kept, 2 * number - 6, 0)
    variance = by_itself[spare > 0].sum() / max(spare[spare > 0].sum(), 1)
    seen = np.where(number > 0, 1.0, np.nan)
    contradiction = np.sqrt(np.maximum(together - by_itself, 0) / 6 / max(variance, 1e-18))
    of_image = kept & (2 * number > 6)
    # Each image has six numbers; each frame and camera pose takes six, each lens its first four
    spent = 6 * int(kept.any(axis=0).sum()) + 6 * int(freedom.pose.sum())
    spent += sum(int(lens[:4].sum()) for lens in freedom.lens)
    left = 6 * int(of_image.sum()) - spent
    between = float((together - by_itself)[of_image].sum()) / max(left, 1)
    excess = max(1.0, between / max(variance, 1e-18)) if left >= _LEAST_SPARE else 1.0
    number = np.maximum(number, 1)
    return (
        seen * np.sqrt(together / number),
        seen * np.sqrt(by_itself / number),
        np.where(2 * number > 6, seen, np.nan) * contradiction,
        excess,
    )


def _coverage(uv: NDArray, of_volume: NDArray, image_size: tuple[int, int]) -> tuple[float, float]:
    """Return the fractions of an image's cells, and of the volume's, that hold some ``uv``."""
    cells, wanted = (
        np.zeros((_COVERAGE_CELLS, _COVERAGE_CELLS), bool),
        np.zeros((_COVERAGE_CELLS, _COVERAGE_CELLS), bool),
    )
    for grid, pixels in ((cells, uv), (wanted, of_volume)):
        at = np.floor((pixels + 0.5) / image_size * _COVERAGE_CELLS).astype(int)
        grid[tuple(np.clip(at, 0, _COVERAGE_CELLS - 1).T)] = True
    return float(cells.mean()), float(cells[wanted].mean()) if wanted.any() else np.nan


def _depths(scene: Scene, observations: ObservationArrays, camera: int) -> NDArray[np.float64]:
    """Return the depths of one camera's observations."""
    frames = observations.frame
    positions = np.einsum("nij,nj->ni", scene.target_R[frames], observations.points)
    return (positions + scene.target_t[frames]) @ scene.camera_R[camera][2] + scene.camera_t[
        camera, 2
    ]


def _rms(squares: NDArray, seen: NDArray, axis: int | tuple[int, ...]) -> NDArray[np.float64]:
    """Return the root of the mean of ``squares`` where ``seen``; NaN where none is."""
    count = seen.sum(axis=axis)
    total = np.where(seen, squares, 0.0).sum(axis=axis)
    return np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _group_rms(squares: NDArray, group: NDArray, used: NDArray, count: int) -> NDArray[np.float64]:
    """Return the root mean of the used ``squares`` of each group; NaN where none."""
    number = np.bincount(group[used], minlength=count)
    total = np.bincount(group[used], squares[used], count)
    return np.sqrt(np.where(number > 0, total / np.maximum(number, 1), np.nan))
