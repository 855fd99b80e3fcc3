"""Cameras, targets and sightings as arrays: what is predicted, and how it depends on each.

A sighting is predicted as ``project(lens_c, R_c (R_f x + t_f) + t_c)`` for target point x, camera
c and frame f. Rotations change by rotation vectors multiplied from the left.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.projection import Lens, project
from rigs.calibrate.observations import Observations


@dataclass(frozen=True)
class Sightings:
    """Sightings in order of camera, then frame; lengths in any unit.

    Parameters
    ----------
    camera, frame : (N,) int64
    points : (N, 3) float64
        Each sighting's point in the target's axes.
    uv : (N, 2) float64
    """

    camera: NDArray[np.int64]
    frame: NDArray[np.int64]
    points: NDArray[np.float64]
    uv: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.uv)

    def where(self, keep: NDArray) -> Sightings:
        """Return the sightings where ``keep`` holds, or in the order it gives."""
        return Sightings(self.camera[keep], self.frame[keep], self.points[keep], self.uv[keep])


@dataclass(frozen=True)
class Scene:
    """Everything that is adjusted.

    Parameters
    ----------
    lenses : tuple of Lens
    camera_R, camera_t : (cameras, 3, 3), (cameras, 3)
        ``x_camera = R x_world + t``.
    target_R, target_t : (frames, 3, 3), (frames, 3)
        ``x_world = R x_target + t``; NaN where a frame has no pose.
    """

    lenses: tuple[Lens, ...]
    camera_R: NDArray[np.float64]  # noqa: N815 (the field's symbol)
    camera_t: NDArray[np.float64]
    target_R: NDArray[np.float64]  # noqa: N815
    target_t: NDArray[np.float64]


@dataclass(frozen=True)
class Freedom:
    """What may be adjusted; the target poses always are.

    Parameters
    ----------
    lens : tuple of (4 + n,) bool
        Of each camera's fx, fy, cx, cy and coefficients.
    pose : (cameras,) bool
    """

    lens: tuple[NDArray[np.bool_], ...]
    pose: NDArray[np.bool_]

    def columns(self, camera: int) -> NDArray[np.bool_]:
        """Return what is free of rotation, translation, fx, fy, cx, cy, coefficients."""
        return np.r_[np.repeat(self.pose[camera], 6), self.lens[camera]]

    @property
    def slices(self) -> list[slice]:
        """Where each camera's free parameters stand among those of all cameras."""
        counts = [int(self.columns(camera).sum()) for camera in range(len(self.lens))]
        ends = np.cumsum([0, *counts])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def predicted(scene: Scene, sightings: Sightings) -> NDArray[np.float64]:
    """Return where the scene has the sightings, ``(N, 2)``; NaN behind the camera."""
    uv = np.full((len(sightings), 2), np.nan)
    for camera, rows in camera_rows(sightings):
        in_camera, *_ = _in_camera(scene, sightings, camera, rows)
        uv[rows] = project(scene.lenses[camera], in_camera)[0]
    return uv


def jacobian(
    scene: Scene, sightings: Sightings, camera: int, rows: slice
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return predictions of one camera's ``rows`` and their derivatives.

    Returns
    -------
    uv : (n, 2) float64
    by_camera : (n, 2, 10 + coefficients) float64
        With respect to the camera's rotation, translation, fx, fy, cx, cy, coefficients.
    by_target : (n, 2, 6) float64
        With respect to the target's rotation and translation.
    """
    in_camera, turned, on_target = _in_camera(scene, sightings, camera, rows)
    uv, by_point, by_lens = project(scene.lenses[camera], in_camera)
    # d (w x p) = -[p] dw, and g . (w x p) = w . (p x g)
    by_camera = np.concatenate([_cross(turned, by_point), by_point, by_lens], axis=2)
    by_world = by_point @ scene.camera_R[camera]  # (n, 2, 3)
    by_target = np.concatenate([_cross(on_target, by_world), by_world], axis=2)
    return uv, by_camera, by_target


def rays_by_camera(
    scene: Scene, camera: int, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the derivatives of the pixels of world ``points`` ``(n, 3)``.

    Returns
    -------
    by_point : (n, 2, 3) float64
        With respect to the point in the world.
    by_camera : (n, 2, 10 + coefficients) float64
        As of `jacobian`.
    """
    turned = points @ scene.camera_R[camera].T
    _, by_point, by_lens = project(scene.lenses[camera], turned + scene.camera_t[camera])
    by_camera = np.concatenate([_cross(turned, by_point), by_point, by_lens], axis=2)
    return by_point @ scene.camera_R[camera], by_camera


def _cross(points: NDArray, gradients: NDArray) -> NDArray[np.float64]:
    """Return ``points`` ``(n, 3)`` times each row of ``gradients`` ``(n, 2, 3)``, crosswise."""
    x, y, z = (points[:, None, axis] for axis in range(3))
    a, b, c = (gradients[:, :, axis] for axis in range(3))
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=2)


def _in_camera(
    scene: Scene, sightings: Sightings, camera: int, rows: slice
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the points in the camera's axes, turned into them, and turned on the target."""
    frames = sightings.frame[rows]
    on_target = np.einsum("nij,nj->ni", scene.target_R[frames], sightings.points[rows])
    turned = (on_target + scene.target_t[frames]) @ scene.camera_R[camera].T
    return turned + scene.camera_t[camera], turned, on_target


def camera_rows(sightings: Sightings) -> list[tuple[int, slice]]:
    """Return each camera that has sightings and where they stand."""
    return runs(sightings.camera)


def runs(values: NDArray[np.int64]) -> list[tuple[int, slice]]:
    """Return each run of equal ``values`` and where it stands."""
    starts = np.r_[0, np.flatnonzero(np.diff(values)) + 1] if len(values) else np.zeros(0, int)
    ends = np.r_[starts[1:], len(values)].astype(int)
    return [(int(values[a]), slice(int(a), int(b))) for a, b in zip(starts, ends, strict=False)]


def ordered(sightings: Sightings | Observations) -> NDArray[np.int64]:
    """Return the order of camera, then frame."""
    return np.lexsort((sightings.frame, sightings.camera))


def image_rows(sightings: Sightings) -> list[tuple[int, int, slice]]:
    """Return camera, frame and place of the sightings of each image."""
    if not len(sightings):
        return []
    change = np.diff(sightings.camera).astype(bool) | np.diff(sightings.frame).astype(bool)
    bounds = np.r_[0, np.flatnonzero(change) + 1, len(sightings)].tolist()
    return [
        (int(sightings.camera[a]), int(sightings.frame[a]), slice(a, b))
        for a, b in pairwise(bounds)
    ]
