"""Points in a box, and the motion of points' images."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera_protocol import CameraLike


def box_points(lower: ArrayLike, upper: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return points evenly spread over a box, faces included; ``count=2`` gives its corners.

    Parameters
    ----------
    lower, upper : (3,) array_like
        Opposite corners.
    count : int
        Points along each side.

    Returns
    -------
    (count ** 3, 3) float64
        z varies fastest, then y, then x.
    """
    corners = zip(np.asarray(lower).tolist(), np.asarray(upper).tolist(), strict=True)
    axes = [np.linspace(low, high, count) for low, high in corners]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def evenly_spread(total: int, count: int) -> NDArray[np.int64]:
    """Return about ``count`` indices below ``total``, evenly spread, both ends included."""
    return np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int))


def image_motion(
    camera: CameraLike, points: NDArray[np.float64], moves: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the motion of points' images for small motions of the points, in pixels, ``(N, 2)``.

    ``(u(x + m) - u(x - m)) / 2``, the derivative along ``m`` to second order; NaN where a
    projection is NaN.

    Parameters
    ----------
    camera : CameraLike
    points : (N, 3)
    moves : (N, 3) or (3,)
        Small compared to the distance from the camera.
    """
    ahead, behind = (camera.project(points + sign * moves)[0] for sign in (1, -1))
    return (ahead - behind) / 2
