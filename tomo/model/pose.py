"""Where every camera stands and looks: its image shifted, turned, magnified, seen from beside."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from rigs import CameraLike
from rigs.geometry.rotation import matrix_of_vector
from tomo.model.effect import Prediction, image_frame
from tomo.model.observation import Observation

SMOOTHING = 0.5
"""Blur before derivatives of a predicted image, in pixels. None: steps between voxels count as
slopes; more: slopes of thin flames are underestimated."""

FIXED = 1e-6
"""Deviation, as a fraction of the prior's, of what a camera without a lens model cannot do."""


@dataclass(frozen=True)
class Pose:
    """A camera that stands or looks elsewhere than the rig says.

    Its image is ``b(u) = (A x)(u - d(u))`` with ``d = (right, down) + roll (-y, x) + zoom (x, y)``
    in pixels, and ``(x, y)`` the coordinates from the principal point in half the image's shorter
    side. ``aside`` and ``above`` walk the camera around the grid's middle, still looking there, by
    the angle that moves points that far nearer by a pixel. A table of rays has no roll and zoom.

    Parameters
    ----------
    sigma : float
        Prior standard deviation in pixels: of shifts, roll and zoom, and of the place where the
        camera stands, at the middle of the grid. A walk is as much smaller as that turns the view.
    """

    sigma: float = 0.5
    name = "pose"
    parameters = ("right", "down", "roll", "zoom", "aside", "above")
    units = ("px", "px", "px", "px", "px", "px")
    shared = False
    positive = False
    of_cameras = True
    of_gas = False

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 6)``."""
        rig, middle = observation.rig, np.asarray(observation.grid.center)
        found = np.full((len(rig), len(self.parameters)), self.sigma)
        for own, camera, pixel in zip(found, rig, rig.footprint(middle), strict=True):
            turn = _frame(camera)[2] * pixel / np.linalg.norm(camera.R @ middle + camera.t)
            own[4:] *= turn if np.isfinite(turn) else 1.0  # NaN by a mirror
        found[[not camera.has_pose for camera in observation.rig], 2:4] *= FIXED
        return found

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return the changes of the prediction by a pixel, ``(6, pixels)``.

        Shift, roll and zoom take the slopes of the predicted images. A walk takes the projection
        of the volume that turns the other way: ``(w x (x - c)) . grad f`` about the axis ``w``.
        """
        about = [np.asarray(image, np.float64) for image in at.turned]
        parts = []
        for view, (camera, image) in enumerate(zip(at.observation.rig, at.images, strict=True)):
            x, y, radius = _frame(camera)
            smooth = gaussian_filter(image, SMOOTHING)
            down, right = (  # an image of a single row or column has no slope across it
                np.gradient(smooth, axis=axis) if n > 1 else np.zeros_like(smooth)
                for axis, n in enumerate(smooth.shape)
            )
            fields = (-right, -down, y * right - x * down, -x * right - y * down)
            start, stop = at.system.projector.view_ptr[view : view + 2]
            turns = np.stack([one[start:stop] for one in about]) / radius  # (3, rows)
            own = [at.of_view(view, field) for field in fields]
            parts.append(np.stack([*own, camera.R[1] @ turns, camera.R[0] @ turns]))
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
    _, _, radius = _frame(camera)
    if aside or above:
        turn = matrix_of_vector((aside * camera.R[1] + above * camera.R[0]) / radius)
        camera = camera.transformed(turn, middle - turn @ middle)
    if camera.has_pose and (roll or zoom):
        matrix = np.array(camera.camera_matrix)
        matrix[:2, :2] *= np.exp(zoom / radius)
        turn = matrix_of_vector(np.array([0.0, 0.0, roll / radius]))
        camera = camera.with_pose(matrix, turn @ camera.R, turn @ camera.t)
    return camera.shifted(right, down) if right or down else camera


def _frame(camera: CameraLike) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    center = tuple(camera.camera_matrix[:2, 2]) if camera.has_pose else None
    return image_frame(camera.image_size, center)
