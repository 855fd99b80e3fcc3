"""Cameras of projection matrices ``(3, 4)``: the pixel of X is ``P (X, 1)`` over its depth.

``P = s K [R | t]`` up to a factor: the left 3 x 3 block is an upper triangular matrix times a
rotation, its sign that of a positive determinant, so that points in front have a positive depth.
Source: Hartley and Zisserman, "Multiple View Geometry" (2003), section 6.2.4.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.geometry.rays import nearest_point
from rigs.geometry.rotation import upper_times_rotation

_MOST_RESIDUAL = (
    1e-6  # pixels between P and its K, R, t; rounding of a sane matrix stays far below
)
_LEAST_PARALLAX = 1e-3  # eigenvalue a camera, radians squared: axes nearer to parallel do not meet


def camera_of_matrix(P: NDArray[np.float64], name: str, image_size: tuple[int, int]) -> Camera:
    """Return the pinhole that projects like ``P`` ``(3, 4)``.

    Raises
    ------
    ValueError
        If the matrix is singular, is a pose without intrinsics, or does not survive to 1e-6 px.
    """
    with np.errstate(all="ignore"):
        scaled = P / np.linalg.norm(P[2, :3])
        regular = np.isfinite(scaled).all() and np.linalg.cond(scaled[:, :3]) < 1e14
    if not regular:
        raise ValueError(
            "P: found a left 3 x 3 block that is singular, expected one of rank 3: a camera with "
            "a centre"
        )
    if np.linalg.det(scaled[:, :3]) < 0:
        scaled = -scaled
    K, R = upper_times_rotation(scaled[:, :3])
    if np.abs(K - np.eye(3)).max() < 1e-3:
        raise ValueError(
            "P: found a pose [R | t], expected K [R | t]: its focal length is 1 pixel"
        )
    t = np.linalg.solve(K, scaled[:, 3])
    camera = Camera(name, image_size, K / K[2, 2] + 0.0, R=R, t=t / K[2, 2], status="calibrated")
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * np.array(image_size, np.float64)
    origins, directions = camera.rays(corners)
    points = origins + directions * max(1.0, float(np.linalg.norm(camera.t)))
    image = np.c_[points, np.ones(4)] @ scaled.T
    residual = float(np.abs(image[:, :2] / image[:, 2:] - corners).max())
    if not residual <= _MOST_RESIDUAL:
        raise ValueError(
            f"P: found K, R, t that project {residual:.2g} px from it, expected {_MOST_RESIDUAL} "
            f"px, which a focal length of {camera.camera_matrix[0, 0]:.2g} px leaves no digits for"
        )
    return camera


def look_away(cameras: Sequence[CameraLike]) -> bool | None:
    """Return whether the point where the axes meet lies behind the cameras; None if undecided.

    It does where a matrix's rows count from the image's bottom: mirrored images turn a camera
    round. Undecided are single cameras, parallel axes, and points in front of some of them only.
    """
    positions = np.array([camera.position for camera in cameras])
    axes = np.array([camera.R[2] for camera in cameras])
    point, certainty = nearest_point(positions, axes)
    if certainty < _LEAST_PARALLAX * len(cameras):
        return None
    in_front = np.sum((point - positions) * axes, axis=1) > 0
    return None if in_front.any() and not in_front.all() else not in_front.any()
