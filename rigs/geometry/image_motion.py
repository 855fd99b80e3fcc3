"""How the images of points move as the points do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rigs.camera import Camera
    from rigs.ray_table import RayTable


def image_motion(
    camera: Camera | RayTable, points: NDArray[np.float64], moves: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far the images of points move as the points do, in pixels: ``(N, 2)``.

    ``(u(x + m) - u(x - m)) / 2``, the derivative along ``m`` to second order; NaN where the camera
    projects to NaN.

    Parameters
    ----------
    camera : Camera or RayTable
    points : (N, 3)
    moves : (N, 3) or (3,)
        Small against the distance from the camera.
    """
    ahead, behind = (camera.project(points + sign * moves)[0] for sign in (1, -1))
    return (ahead - behind) / 2
