"""Coverage of given points by a rig: views, pixel sizes, blur, ray-miss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera_protocol import CameraLike
from rigs.check.lines_of_sight import angles_between, expected_ray_miss
from rigs.check.resolved_wavelength import ViewsOfObject
from rigs.geometry.points import image_motion
from rigs.rig import Rig

PIXEL_ACCURACY = 0.2
"""RMS error of a line of sight in pixels, per image axis, without a calibration's figure."""


@dataclass(frozen=True, eq=False)
class Coverage:
    """How a rig's cameras see points; made by `coverage`.

    Attributes
    ----------
    rig : Rig
    points : (N, 3) float64
        In the rig's length unit.
    seen : (C, N) bool
        Whether a camera's image holds the point.
    directions : (N, C, 3) float64
        Unit vectors along the lines of sight, from the cameras to the points.
    footprint : (C, N) float64
        Size of a pixel at the point, across the line of sight; NaN where not seen.
    blur : (C, N) float64
        Diameter at the point of the defocus cone of a pixel's centre; NaN where not seen or where
        the lens's figures are unknown.
    ray_miss : (N,) float64
        Expected RMS distance of the lines of sight from their best common point, for the pixel
        accuracy given; NaN with fewer than two views.
    """

    rig: Rig
    points: NDArray[np.float64]
    seen: NDArray[np.bool_]
    directions: NDArray[np.float64]
    footprint: NDArray[np.float64]
    blur: NDArray[np.float64]
    ray_miss: NDArray[np.float64]

    def __repr__(self) -> str:
        """Name the sizes: the arrays themselves are too long to print."""
        return f"<Coverage of {len(self.points)} points by {len(self.rig)} cameras>"

    @property
    def views(self) -> NDArray[np.int64]:
        """Number of cameras that see each point, ``(N,)``."""
        return self.seen.sum(axis=0)

    @property
    def blur_in_pixels(self) -> NDArray[np.float64]:
        """`blur` over `footprint`, ``(C, N)``."""
        return self.blur / self.footprint

    @property
    def median_footprint(self) -> NDArray[np.float64]:
        """The median over the cameras that see a point, ``(N,)``; NaN where none does."""
        median = np.full(len(self.points), np.nan)
        some = self.seen.any(axis=0)
        if some.any():
            median[some] = np.nanmedian(self.footprint[:, some], axis=0)
        return median

    def angles_to_middle(self) -> NDArray[np.float64]:
        """Return the angles in degrees between lines from cameras to the points' mean, ``(C, C)``.

        See `rigs.check.lines_of_sight.angles_between`.
        """
        away = self.points.mean(axis=0) - np.array([camera.position for camera in self.rig])
        return angles_between(away)

    def views_of(self, covariance: NDArray[np.float64], voxel: float) -> ViewsOfObject:
        """Return the points' views of an object of that covariance ``(3, 3)``."""
        return ViewsOfObject(self.directions, self.seen.T, self.footprint.T, covariance, voxel)


def coverage(
    rig: Rig, points: ArrayLike, *, pixel_accuracy: ArrayLike = PIXEL_ACCURACY
) -> Coverage:
    """Return how the cameras of a rig see points.

    Parameters
    ----------
    rig : Rig
        At least one camera.
    points : (N, 3) array_like
        In the rig's length unit; for example voxels' centres.
    pixel_accuracy : float or (C,) array_like
        RMS error of each camera's lines of sight, in pixels along each image axis.

    Raises
    ------
    ValueError
        If the rig is empty, or points or accuracies are of the wrong shape or not finite.

    Notes
    -----
    A pixel's size at a point is ``1 / sqrt(|det J|)`` with J the derivative of the pixel
    coordinates across the line of sight: depth over focal length on a pinhole's axis.

    The blur is that of a thin lens of diameter ``D`` (focal length over f-number) focused at the
    depth ``s``: the cone of light through the lens's rim is ``D |1 - z / s|`` wide at the depth
    ``z``, as in `tomo.simulation.effects`; divided by the pixel's size it is the circle of
    confusion in pixels.

    With independent errors of RMS ``a_i`` (accuracy times pixel size) along both directions
    across each line, the best common point of n lines has

        ray_miss² = (sum_i 2 a_i² - tr(M^-1 sum_i a_i² P_i)) / n ,   M = sum_i P_i ,

    where ``P_i = I - d_i d_i^T`` projects across line i. For many views of equal accuracy that
    is nearly ``2 a²``.
    """
    points = np.asarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"points: found shape {points.shape}, expected finite (N, 3)")
    if not len(rig):
        raise ValueError("rig: found no camera, expected at least one")
    accuracy = np.asarray(pixel_accuracy, np.float64)
    if (
        accuracy.shape not in ((), (len(rig),))
        or not (np.isfinite(accuracy) & (accuracy > 0)).all()
    ):
        raise ValueError(
            f"pixel_accuracy: found {pixel_accuracy!r}, expected a positive number or {len(rig)}"
        )
    seen = np.zeros((len(rig), len(points)), bool)
    footprint = np.full(seen.shape, np.nan)
    blur = np.full(seen.shape, np.nan)
    directions = np.zeros((len(points), len(rig), 3))
    for number, camera in enumerate(rig):
        view = _view(camera, points)
        directions[:, number], seen[number], footprint[number], blur[number] = view
    error = footprint * np.broadcast_to(accuracy, len(rig))[:, None]
    miss = expected_ray_miss(directions, np.where(seen, error, np.nan).T)
    return Coverage(rig, points, seen, directions, footprint, blur, miss)


def _view(camera: CameraLike, points: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return each point's line of sight, whether it is in the image, pixel size and blur."""
    uv, depth, _ = camera.project(points)
    seen = camera.inside(uv)
    footprint = np.full(len(points), np.nan)
    blur = np.full(len(points), np.nan)
    away = points - camera.position
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    lines = away / np.maximum(distance, 1e-300)  # (N, 3)
    if not seen.any():
        return lines, seen, footprint, blur
    if not camera.has_lens_model:  # stored rays may have different origins
        origins, lines[seen] = camera.rays(uv[seen])
        distance[seen, 0] = np.linalg.norm(points[seen] - origins, axis=1)
    along, distance = lines[seen], distance[seen]
    helper = np.eye(3)[np.abs(along).argmin(axis=1)]
    first = np.cross(helper, along)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
    step = 1e-4 * distance  # 1e-4 rad: far above rounding, far below the scale of distortion
    derivative = [
        image_motion(camera, points[seen], step * direction) / step
        for direction in (first, np.cross(along, first))
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        area = np.abs(
            derivative[0][:, 0] * derivative[1][:, 1] - derivative[0][:, 1] * derivative[1][:, 0]
        )
        footprint[seen] = 1 / np.sqrt(area)
    optics = camera.optics
    if optics and optics.focal_length and optics.f_number and optics.focus_distance:
        aperture = optics.focal_length / optics.f_number
        blur[seen] = aperture * np.abs(1 - depth[seen] / optics.focus_distance)
    return lines, seen, footprint, blur
