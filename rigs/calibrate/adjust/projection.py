"""Projection of points in a camera's axes, with derivatives by point and lens.

The perspective models are OpenCV's own (``cv2.projectPoints``); the fisheye is written out, as
OpenCV's stops at a right angle off the axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.lens import Distortion
from rigs.lens.distortion import COEFFICIENT_COUNTS

_NEAREST = 1e-9  # depth in target sizes; below it a perspective camera projects to NaN


@dataclass(frozen=True)
class Lens:
    """Intrinsics that map a camera's axes to pixels: ``pixel = K @ distorted(x / z, y / z)``."""

    matrix: NDArray[np.float64]  # (3, 3)
    model: str  # of `rigs.Distortion`
    coefficients: NDArray[np.float64]  # (n,)

    @property
    def distortion(self) -> Distortion:
        """The coefficients as a `rigs.Distortion`."""
        return Distortion(self.model, tuple(self.coefficients.tolist()))

    @property
    def size(self) -> int:
        """Number of adjustable values: fx, fy, cx, cy and the coefficients."""
        return 4 + len(self.coefficients)

    def moved(self, step: NDArray[np.float64]) -> Lens:
        """Return the lens after adding ``step`` ``(size,)`` to fx, fy, cx, cy, coefficients."""
        matrix = self.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
        return Lens(matrix, self.model, self.coefficients + step[4:])

    def with_model(self, model: str, count: int | None = None) -> Lens:
        """Return the lens in another model; coefficients both know keep their values."""
        count = COEFFICIENT_COUNTS[model][-1] if count is None else count
        coefficients = np.zeros(count)
        if (model == "fisheye") == (self.model == "fisheye"):
            shared = min(count, len(self.coefficients))
            coefficients[:shared] = self.coefficients[:shared]
        return Lens(self.matrix, model, coefficients)

    def pinhole(self, uv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``x / z, y / z`` ``(N, 2)`` of the directions at ``uv`` ``(N, 2)``, or NaN."""
        plane = np.linalg.solve(self.matrix, np.c_[uv, np.ones(len(uv))].T).T[:, :2]
        directions = self.distortion.unproject(plane)
        depth = directions[:, 2:]
        return np.where(depth > 0.05, directions[:, :2] / np.where(depth > 0.05, depth, 1), np.nan)


def project(
    lens: Lens, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the pixels of ``points`` ``(N, 3)`` in the camera's axes, and their derivatives.

    The pixels ``(N, 2)`` are NaN behind a perspective camera; folds of the lens are not detected.
    Derivatives are by the point ``(N, 2, 3)``, and by fx, fy, cx, cy and the coefficients ``(N, 2,
    4 + n)``.
    """
    if lens.model == "fisheye":
        plane, by_point, by_coefficients = _fisheye(lens.coefficients, points)
    else:
        plane, by_point, by_coefficients = _perspective(lens.coefficients, points)
    linear = lens.matrix[:2, :2]
    uv = plane @ linear.T + lens.matrix[:2, 2]
    by_lens = np.zeros((len(points), 2, lens.size))
    by_lens[:, 0, 0] = plane[:, 0]
    by_lens[:, 1, 1] = plane[:, 1]
    by_lens[:, 0, 2] = by_lens[:, 1, 3] = 1
    by_lens[:, :, 4:] = linear @ by_coefficients
    return uv, linear @ by_point, by_lens


def _perspective(
    coefficients: NDArray, points: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the image plane's coordinates and derivatives of OpenCV's perspective lens."""
    import cv2

    if not len(points):
        return np.zeros((0, 2)), np.zeros((0, 2, 3)), np.zeros((0, 2, len(coefficients)))
    full = coefficients if len(coefficients) else np.zeros(4)
    ahead = points[:, 2] > _NEAREST
    safe = np.where(ahead[:, None], points, [0.0, 0.0, 1.0])
    origin = np.zeros(3)
    projected, derivatives = cv2.projectPoints(safe, origin, origin, np.eye(3), full)
    plane = np.where(ahead[:, None], np.asarray(projected, np.float64).reshape(-1, 2), np.nan)
    jacobian = np.asarray(derivatives, np.float64).reshape(len(points), 2, -1)
    # OpenCV's columns: rotation 3, translation 3, focal lengths 2, principal point 2, lens
    return plane, jacobian[:, :, 3:6], jacobian[:, :, 10 : 10 + len(coefficients)]


def _fisheye(
    coefficients: NDArray, points: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the same for the fisheye: radius = angle (1 + k1 angle² + ... + k4 angle⁸)."""
    x, y, z = points.T
    across = np.hypot(x, y)
    on_axis = across < 1e-12 * np.abs(z)
    safe = np.where(on_axis, 1.0, across)
    angle = np.arctan2(across, z)
    powers = angle[:, None] ** (2 * np.arange(5))  # (N, 5)
    terms = np.r_[1.0, coefficients]
    radius = angle * (powers @ terms)
    slope = powers @ (terms * (2 * np.arange(5) + 1))
    unit = np.where(on_axis[:, None], 0.0, points[:, :2] / safe[:, None])
    plane = radius[:, None] * unit
    # d angle / d point, and d unit / d (x, y) = (I - unit unit^T) / across
    length2 = across**2 + z**2
    by_angle = np.stack([z * unit[:, 0], z * unit[:, 1], -across], -1) / length2[:, None]
    gain = np.where(on_axis, 1.0 / np.where(on_axis, z, 1.0), radius / safe)
    by_point = slope[:, None, None] * unit[:, :, None] * by_angle[:, None, :]
    by_point[:, :, :2] += gain[:, None, None] * (np.eye(2) - unit[:, :, None] * unit[:, None, :])
    by_coefficients = unit[:, :, None] * (angle[:, None] * powers[:, 1:])[:, None, :]
    return plane, by_point, by_coefficients
