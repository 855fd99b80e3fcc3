"""Cameras, targets and observations as arrays: predictions and their derivatives.

An observation is predicted as ``project(lens_c, R_c (R_f x + t_f) + t_c)`` for target point x,
camera c and frame f. Rotations change by rotation vectors multiplied from the left. Through a
scene the point is replaced by an apparent one, as far from the camera in the direction in which
the point is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.projection import Lens, project
from rigs.calibrate.observations import Observations
from rigs.calibrate.refraction.refraction import Refraction
from rigs.calibrate.refraction.routes import routes_to


@dataclass(frozen=True)
class ObservationArrays:
    """Observations in order of camera, then frame; lengths in any unit.

    Points are in the target's axes, and move with a velocity in those of the frame's pose where
    images of one frame are of different moments. Routes are those of `routes_to`.
    """

    camera: NDArray[np.int64]  # (N,)
    frame: NDArray[np.int64]  # (N,)
    points: NDArray[np.float64]  # (N, 3)
    uv: NDArray[np.float64]  # (N, 2)
    velocity: NDArray[np.float64] | None = None  # (N, 3)
    routes: NDArray[np.int64] | None = None  # (N, R)

    def __len__(self) -> int:
        return len(self.uv)

    def where(self, keep: NDArray) -> ObservationArrays:
        """Return the observations where ``keep`` holds, or in the order it gives."""
        rows = {name: each[keep] for name, each in vars(self).items() if each is not None}
        return replace(self, **rows)

    def after(self, delay: NDArray[np.float64]) -> ObservationArrays:
        """Return the observations of points that have moved on for each camera's ``delay``."""
        if self.velocity is None:
            return self
        return replace(self, points=self.points + delay[self.camera, None] * self.velocity)

    def scaled(self, factor: float) -> ObservationArrays:
        """Return the observations with all lengths multiplied by ``factor``."""
        velocity = None if self.velocity is None else self.velocity * factor
        return replace(self, points=self.points * factor, velocity=velocity)


@dataclass(frozen=True)
class Scene:
    """The unknowns of the adjustment: lenses, camera poses and target poses.

    They are ``x_camera = R x_world + t`` and ``x_world = R x_target + t``, NaN where a frame has
    no pose. A camera's images were taken ``offset`` after their frame's moment, in the unit of
    the observations' velocities; observations with routes are seen through the ``refraction``.
    """

    lenses: tuple[Lens, ...]
    camera_R: NDArray[np.float64]  # noqa: N815 (the field's symbol), (cameras, 3, 3)
    camera_t: NDArray[np.float64]  # (cameras, 3)
    target_R: NDArray[np.float64]  # noqa: N815, (frames, 3, 3)
    target_t: NDArray[np.float64]  # (frames, 3)
    offset: NDArray[np.float64] | None = None  # (cameras,)
    refraction: Refraction | None = None

    @property
    def windows(self) -> tuple[str, ...]:
        """The windows whose numbers are adjusted, by name."""
        return () if self.refraction is None else tuple(p.name for p in self.refraction.priors)

    @property
    def delays(self) -> NDArray[np.float64]:
        """How late each camera took its images, ``(cameras,)``; 0 where nothing says so."""
        return np.zeros(len(self.lenses)) if self.offset is None else self.offset

    def scaled(self, factor: float) -> Scene:
        """Return the scene with all lengths multiplied by ``factor``."""
        return replace(
            self,
            camera_t=self.camera_t * factor,
            target_t=self.target_t * factor,
            refraction=self.refraction and self.refraction.with_lengths_scaled(factor),
        )

    def centers(self) -> NDArray[np.float64]:
        """Return where the cameras are, ``(cameras, 3)``."""
        return -np.einsum("cji,cj->ci", self.camera_R, self.camera_t)


def predicted(scene: Scene, observations: ObservationArrays) -> NDArray[np.float64]:
    """Return the predicted pixels of the observations, ``(N, 2)``; NaN behind a camera."""
    uv = np.full((len(observations), 2), np.nan)
    for camera, rows in camera_rows(observations):
        in_camera, *_ = _in_camera(scene, observations, camera, rows)
        if scene.refraction is not None and observations.routes is not None:
            routes = observations.routes[rows]
            in_camera = _apparent(scene, scene.refraction, camera, in_camera, routes)
        uv[rows] = project(scene.lenses[camera], in_camera)[0]
    return uv


def jacobian(
    scene: Scene, observations: ObservationArrays, camera: int, rows: slice
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return pixels ``(n, 2)`` of a camera's ``rows``, and derivatives by camera and target.

    Those by the camera ``(n, 2, 10 + coefficients)`` follow `Freedom`'s order, to the moment and
    the windows where observations have velocities or routes; by the target's pose ``(n, 2, 6)``.
    """
    in_camera, turned, on_target = _in_camera(scene, observations, camera, rows)
    routes = None if observations.routes is None else observations.routes[rows]
    uv, by_world, by_camera, by_window = _derivatives(scene, camera, in_camera, turned, routes)
    by_target = np.concatenate([_cross(on_target, by_world), by_world], axis=2)
    if observations.velocity is not None:
        turn = scene.target_R[observations.frame[rows]]
        by_time = by_world @ (turn @ observations.velocity[rows][:, :, None])
        by_camera = np.concatenate([by_camera, by_time], axis=2)
    elif by_window.shape[2]:
        by_camera = np.concatenate([by_camera, np.zeros((len(uv), 2, 1))], axis=2)
    return uv, np.concatenate([by_camera, by_window], axis=2), by_target


def rays_by_camera(
    scene: Scene, camera: int, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return derivatives of the pixels of world ``points`` ``(n, 3)``, by point and camera.

    They are ``(n, 2, 3)``, and ``(n, 2, 10 + coefficients)`` as of `jacobian`.
    """
    turned = points @ scene.camera_R[camera].T
    in_camera, routes = turned + scene.camera_t[camera], None
    if scene.refraction is not None:
        routes = routes_to(scene.refraction, scene.centers()[camera], points)[0]
    _, by_world, by_camera, by_window = _derivatives(scene, camera, in_camera, turned, routes)
    if by_window.shape[2]:
        no_time = np.zeros((len(points), 2, 1))
        by_camera = np.concatenate([by_camera, no_time, by_window], axis=2)
    return by_world, by_camera


def _derivatives(
    scene: Scene, camera: int, in_camera: NDArray, turned: NDArray, routes: NDArray | None
) -> tuple[NDArray[np.float64], ...]:
    """Return pixels and their derivatives by the point in the world, the camera, the windows.

    A pixel does not change with the apparent point's distance s, so that s is constant: with the
    direction d (C, X) from the centre ``C = -R^T t``, the apparent point is ``s R d``, and
    ``dC = R^T (w x t) - R^T dt``.
    """
    lens, R = scene.lenses[camera], scene.camera_R[camera]
    if scene.refraction is None or routes is None:
        uv, by_point, by_lens = project(lens, in_camera)
        # d (w x p) = -[p] dw, and g . (w x p) = w . (p x g)
        by_camera = np.concatenate([_cross(turned, by_point), by_point, by_lens], axis=2)
        return uv, by_point @ R, by_camera, np.zeros((len(uv), 2, 0))
    center = scene.centers()[camera]
    direction, *by = scene.refraction.derivatives(center, in_camera @ R + center, routes)
    distance = np.linalg.norm(in_camera, axis=1, keepdims=True)
    apparent = distance * direction @ R.T
    uv, by_point, by_lens = project(lens, apparent)
    by_direction = by_point @ R * distance[:, :, None]
    by_center, by_world, by_window = (by_direction @ each for each in by)
    by_shift = -by_center @ R.T
    t = np.broadcast_to(scene.camera_t[camera], apparent.shape)
    by_turn = _cross(apparent, by_point) - _cross(t, by_shift)
    by_camera = np.concatenate([by_turn, by_shift, by_lens], axis=2)
    return uv, by_world, by_camera, by_window


def _apparent(
    scene: Scene, refraction: Refraction, camera: int, in_camera: NDArray, routes: NDArray
) -> NDArray[np.float64]:
    """Return points in the camera's axes where they appear: in the direction of their light."""
    center, R = scene.centers()[camera], scene.camera_R[camera]
    direction = refraction.directions(center, in_camera @ R + center, routes)
    return np.linalg.norm(in_camera, axis=1, keepdims=True) * direction @ R.T


def _cross(points: NDArray, gradients: NDArray) -> NDArray[np.float64]:
    """Return ``points`` ``(n, 3)`` times each row of ``gradients`` ``(n, 2, 3)``, crosswise."""
    x, y, z = (points[:, None, axis] for axis in range(3))
    a, b, c = (gradients[:, :, axis] for axis in range(3))
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=2)


def _in_camera(
    scene: Scene, observations: ObservationArrays, camera: int, rows: slice
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the points in the camera's axes, turned into them, and turned on the target."""
    frames, points = observations.frame[rows], observations.points[rows]
    if scene.offset is not None and observations.velocity is not None:
        points = points + scene.offset[camera] * observations.velocity[rows]
    on_target = np.einsum("nij,nj->ni", scene.target_R[frames], points)
    turned = (on_target + scene.target_t[frames]) @ scene.camera_R[camera].T
    return turned + scene.camera_t[camera], turned, on_target


def world_points(scene: Scene, observations: ObservationArrays) -> NDArray[np.float64]:
    """Return where the observed points are in the world, ``(N, 3)``; NaN without a pose."""
    frames = observations.frame
    turned = np.einsum("nij,nj->ni", scene.target_R[frames], observations.points)
    return turned + scene.target_t[frames]


def camera_rows(observations: ObservationArrays) -> list[tuple[int, slice]]:
    """Return each camera that has observations, and the slice of its rows."""
    return runs(observations.camera)


def runs(values: NDArray[np.int64]) -> list[tuple[int, slice]]:
    """Return the value of each run of equal ``values``, and its slice."""
    starts = np.r_[0, np.flatnonzero(np.diff(values)) + 1] if len(values) else np.zeros(0, int)
    ends = np.r_[starts[1:], len(values)].astype(int)
    return [(int(values[a]), slice(int(a), int(b))) for a, b in zip(starts, ends, strict=False)]


def ordered(observations: ObservationArrays | Observations) -> NDArray[np.int64]:
    """Return the order of camera, then frame."""
    return np.lexsort((observations.frame, observations.camera))


def image_rows(observations: ObservationArrays) -> list[tuple[int, int, slice]]:
    """Return camera, frame and slice of the observations of each image."""
    if not len(observations):
        return []
    change = np.diff(observations.camera).astype(bool) | np.diff(observations.frame).astype(bool)
    bounds = np.r_[0, np.flatnonzero(change) + 1, len(observations)].tolist()
    return [
        (int(observations.camera[a]), int(observations.frame[a]), slice(a, b))
        for a, b in pairwise(bounds)
    ]
