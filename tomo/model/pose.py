"""Where every camera stands and looks, and how far off a rig says it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from rigs import Accuracy, CameraLike, Rig, box_points
from rigs.changes import recorded
from rigs.check.rig_check import calibrated_ray_miss
from rigs.geometry.rotation import matrix_of_vector
from rigs.scene.scene_camera import own_camera, with_own_camera
from tomo.grid import VoxelGrid
from tomo.model.effect import Prediction, image_frame
from tomo.model.observation import Observation

NOMINAL = Accuracy(shift=5.0, roll=1.0, magnification=0.03, direction=1.0)
"""Errors of cameras whose places are those of a drawing: pixels, degrees, a fraction. Less, they
hold the scene beside calibrated cameras; more, only these do."""


def stated_errors(rig: Rig, grid: VoxelGrid, pixel: float = 1.0) -> NDArray[np.float64]:
    """Return standard deviations of the parameters of `tomo.model.Pose`, ``(views, 6)``.

    Those of each camera's `rigs.Accuracy`. What that lacks follows from the figures of the rig's
    calibration: the ray-miss at the middle of the grid, and for the magnification the error of the
    focal length; else it is `NOMINAL` for a nominal camera, and zero for others. ``pixel`` is the
    width of a pixel, in those of the images as recorded.
    """
    found = []
    for camera, footprint in zip(rig, rig.footprint(grid.center), strict=True):
        radius = min(camera.image_size) / 2
        if camera.status == "nominal":
            usual = NOMINAL.with_pixels_scaled(pixel)
        else:
            usual = _of_calibration(rig, camera, float(footprint), radius)
        known = {n: v for n, v in vars(camera.accuracy or Accuracy()).items() if v is not None}
        one = replace(usual, **known)
        roll, direction = (radius * np.deg2rad(angle) for angle in (one.roll, one.direction))
        zoom = radius * one.magnification
        found.append([one.shift, one.shift, roll, zoom, direction, direction])
    return np.array(found, np.float64)


def _of_calibration(rig: Rig, camera: CameraLike, footprint: float, radius: float) -> Accuracy:
    """Return the accuracy that the figures of a rig's calibration come to."""
    pixels = (calibrated_ray_miss(rig, camera.name) or 0.0) / footprint
    if not math.isfinite(pixels):  # the grid is behind the camera
        pixels = 0.0
    focal = recorded(rig, "focal_length_error", camera.name) or pixels / radius
    angle = np.rad2deg(pixels / radius)
    return Accuracy(pixels, angle, focal, angle)


SMOOTHING = 0.5
"""Blur before derivatives of a predicted image, in pixels. None: steps between voxels count as
slopes; more: slopes of thin flames are underestimated."""

FIXED = 1e-6
"""Deviation, in pixels, of a camera that stays; as a fraction of the prior's, that of what a
camera without a lens model cannot do."""

LATTICE = 5
"""Points along each edge of the grid whose images say how a camera moved."""


@dataclass(frozen=True)
class Pose:
    """A camera that stands or looks elsewhere than the rig says.

    Its image is ``b(u) = (A x)(u - d(u))`` with ``d = (right, down) + roll (-y, x) + zoom (x, y)``
    in pixels, and ``(x, y)`` the coordinates from the principal point in half the image's shorter
    side. ``aside`` and ``above`` walk the camera around the grid's middle, still looking there, by
    the angle that moves points that far nearer by a pixel. A table of rays has no roll and zoom.
    Glass and mirrors stay where they are.

    Parameters
    ----------
    sigma : float
        Prior standard deviation in pixels of the images as recorded: of shifts, roll, zoom and of
        the place where the camera stands, at the middle of the grid. A walk is smaller by as much
        as that turns the view. It is what mounts do after cameras were measured, whatever the rig
        states of its errors, because any camera may have been knocked; these decide who holds the
        scene, see `without_gauge`.
    of_camera : mapping of str to float
        That of some cameras, by name, in place of ``sigma``; 0 for one that stays where it is.
    """

    sigma: float = 0.5
    of_camera: Mapping[str, float] = field(default_factory=dict)
    name = "pose"
    parameters = ("right", "down", "roll", "zoom", "aside", "above")
    units = ("px", "px", "px", "px", "px", "px")
    shared = False
    positive = False
    of_cameras = True
    of_gas = False
    field_of = None

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 6)``."""
        rig, middle = observation.rig, np.asarray(observation.grid.center)
        sigma = [max(self.of_camera.get(name, self.sigma), FIXED) for name in rig.names]
        found = np.repeat([sigma], len(self.parameters), axis=0).T / observation.pixel
        for own, camera, pixel in zip(found, rig, rig.footprint(middle), strict=True):
            turn = _frame(camera)[1] * pixel / np.linalg.norm(camera.R @ middle + camera.t)
            own[4:] *= turn if np.isfinite(turn) else 1.0  # NaN by a mirror
        found[[not own_camera(camera).has_pose for camera in rig], 2:4] *= FIXED
        return found

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return the changes of the prediction by a pixel, ``(6, pixels)``.

        Shift, roll and zoom take the slopes of the predicted images, a walk the projection of the
        volume that turns the other way: ``(w x (x - c)) . grad f`` about the axis ``w``; behind
        glass, or by a mirror, what of both looks most like it.
        """
        about = [np.asarray(image, np.float64) for image in at.turned]
        parts = []
        for view, (camera, image) in enumerate(zip(at.observation.rig, at.images, strict=True)):
            center, radius = _frame(camera)
            x, y, _ = image_frame(camera.image_size, tuple(center))
            smooth = gaussian_filter(image, SMOOTHING)
            down, right = (  # an image of a single row or column has no slope across it
                np.gradient(smooth, axis=axis) if n > 1 else np.zeros_like(smooth)
                for axis, n in enumerate(smooth.shape)
            )
            fields = (-right, -down, y * right - x * down, -x * right - y * down)
            start, stop = at.system.projector.view_ptr[view : view + 2]
            own = np.stack([at.of_view(view, field) for field in fields])
            turns = np.stack([one[start:stop] for one in about]) / radius  # (3, rows)
            walks = _walks(camera, at.observation.grid) @ np.concatenate([own, turns])
            parts.append(np.concatenate([own, walks]))
        return np.concatenate(parts, axis=1)

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the observation with the cameras where they are."""
        middle = np.asarray(observation.grid.center)
        cameras = tuple(
            moved(camera, own, middle) if own.any() else camera
            for camera, own in zip(observation.rig, values, strict=True)
        )
        return replace(observation, rig=replace(observation.rig, cameras=cameras))


def moved(
    camera: CameraLike, motion: NDArray[np.float64], middle: NDArray[np.float64]
) -> CameraLike:
    """Return the camera moved by ``(right, down, roll, zoom, aside, above)``, see `Pose`."""
    right, down, roll, zoom, aside, above = motion
    own, (_, radius) = own_camera(camera), _frame(camera)
    if aside or above:
        own = _walked(own, aside / radius, above / radius, _apparent(camera, middle))
    if own.has_pose and (roll or zoom):
        matrix = np.array(own.camera_matrix)
        matrix[:2, :2] *= np.exp(zoom / radius)
        turn = matrix_of_vector(np.array([0.0, 0.0, roll / radius]))
        accuracy = own.accuracy  # of the rig as it was given, which the gauge goes by
        own = own.with_pose(matrix, turn @ own.R, turn @ own.t).with_accuracy(accuracy)
    return with_own_camera(camera, own.shifted(right, down) if right or down else own)


def image_motions(
    camera: CameraLike, points: NDArray[np.float64], middle: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by how much points' images move: by the parameters of `Pose`, and by the points.

    ``(6, N, 2)`` and ``(N, 2, 3)`` of points (N, 3), and the ``middle`` (3,) of the grid; NaN
    where a point is not seen. Roll and zoom of a table of rays are those that a lens would have.
    """
    uv = np.asarray(camera.project(points)[0])
    by_point = _by_point(camera, uv, points)
    center, radius = _frame(camera)
    at = (uv - center) / radius
    found = [np.tile(axis, (len(points), 1)) for axis in np.eye(2)]
    found += [at[:, ::-1] * (-1, 1), at]
    own, about = own_camera(camera), _apparent(camera, middle)
    for aside, above in np.eye(2) / 2 / radius:
        walked = (_walked(own, way * aside, way * above, about) for way in (1, -1))
        ahead, behind = (_misses(with_own_camera(camera, one), uv, points) for one in walked)
        found.append(np.einsum("nij,nj->ni", by_point, behind - ahead))
    return np.array(found), by_point


def _walked(
    camera: CameraLike, aside: float, above: float, about: NDArray[np.float64]
) -> CameraLike:
    """Return a camera turned about a point by angles about its axes down and right."""
    turn = matrix_of_vector(aside * camera.R[1] + above * camera.R[0])
    return camera.transformed(turn, about - turn @ about)


def _by_point(
    camera: CameraLike, uv: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the derivatives of the pixels of points by the points, ``(N, 2, 3)``."""
    right, down = (
        _misses(camera, uv + one, points) - _misses(camera, uv - one, points)
        for one in np.eye(2) / 2
    )
    across = np.stack([right, down], axis=2)  # (N, 3, 2)
    seen = np.isfinite(across).all(axis=(1, 2))
    found = np.full((len(points), 2, 3), np.nan)
    found[seen] = np.linalg.pinv(across[seen])
    return found


def _misses(
    camera: CameraLike, uv: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the ways from points to the lines of sight of pixels, ``(N, 3)``."""
    origins, directions = camera.rays(uv)
    along = np.sum((points - origins) * directions, axis=1, keepdims=True)
    return origins + along * directions - points


@lru_cache(maxsize=256)
def _walks(camera: CameraLike, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return what a walk by a pixel is made of: shift, roll, zoom, turns of the volume: (2, 7).

    Turns are about the world's axes, the other way. Glass and mirrors make of a walk a turn about
    other axes, and motions of its image. The last ones are kept: the same cameras are asked for
    again.
    """
    if camera.is_straight:
        return np.concatenate([np.zeros((2, 4)), camera.R[[1, 0]]], axis=1)
    middle = np.asarray(grid.center)
    points = box_points(grid.lower, grid.upper, LATTICE)
    by_pose, by_point = image_motions(camera, points, middle)
    turns = np.cross(points - middle, camera.R[:2, None]) / _frame(camera)[1]  # (2, N, 3)
    parts = [*by_pose[:4], *np.einsum("nij,knj->kni", by_point, turns), *by_pose[4:]]
    seen = np.isfinite(parts).all(axis=(0, 2))
    made = np.array(parts)[:, seen].reshape(8, -1).T
    found = np.linalg.lstsq(made[:, :6], made[:, 6:], rcond=1e-6)[0].T  # (2, 6)
    return np.concatenate([found[:, :4], found[:, 4:] @ camera.R[:2]], axis=1)


def _apparent(camera: CameraLike, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a camera's own lens sees a point: behind glass or by a mirror elsewhere."""
    own = own_camera(camera)
    if own is camera:
        return point
    uv = camera.project(point[None])[0]
    (origin,), (direction,) = own.rays(uv)
    size = np.sqrt(np.square(_by_point(camera, uv, point[None])).sum() / 2)  # pixels of a length
    focal = np.sqrt(own.camera_matrix[0, 0] * own.camera_matrix[1, 1])
    found = origin + direction * focal / size / (direction @ own.R[2])
    return found if np.isfinite(found).all() else point


def _frame(camera: CameraLike) -> tuple[NDArray[np.float64], float]:
    """Return the principal point of a camera's own lens, and half its image's shorter side."""
    own = own_camera(camera)
    width, height = own.image_size
    middle = np.array([width - 1, height - 1]) / 2
    center = own.camera_matrix[:2, 2] if own.has_pose else middle
    return np.asarray(center, np.float64), min(width, height) / 2
