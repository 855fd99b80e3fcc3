"""Kalibr's models of very wide lenses: the direction of each point of the image plane.

They have no counterpart in `rigs.lens`; their cameras become tables of rays. Sources:
Mei and Rives, "Single view point omnidirectional camera calibration from planar grids" (2007), for
omni; Usenko, Demmel and Cremers, "The double sphere camera model" (2018), for ds (their equations
46 to 51) and eucm (34 to 36).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.formats._image_size import check_table_size
from rigs.ray_table import RayTable

#: Parameters before the focal lengths and the principal point.
PARAMETERS = {"omni": ("xi",), "ds": ("xi", "alpha"), "eucm": ("alpha", "beta")}


def table_of(camera: Camera, model: str, parameters: Sequence[float]) -> RayTable:
    """Return a camera with such a lens, behind the lens of ``camera``, as a table of rays."""
    check_table_size(camera.image_size)
    behind = camera.rays()[1] @ camera.R.T  # the model's own image plane, at depth one
    seen = directions(model, parameters, behind[:, :2] / behind[:, 2:]) @ camera.R
    rows = seen.reshape(*camera.image_size[::-1], 3)
    return RayTable(camera.name, camera.position, rows, status=camera.status)


def directions(
    model: str, parameters: Sequence[float], plane: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return unit vectors ``(N, 3)`` seen at ``plane`` ``(N, 2)``, in focal lengths; or NaN."""
    q = (plane**2).sum(axis=1)
    with np.errstate(all="ignore"):
        values = np.array(parameters, np.float64)  # a float of Python raises on overflow
        if model == "omni":
            (xi,) = values
            gain, forward, shift = (xi + np.sqrt(1 + (1 - xi**2) * q)) / (q + 1), 1.0, xi
        elif model == "ds":
            xi, alpha = values
            root = np.sqrt(1 - (2 * alpha - 1) * q)
            forward = (1 - alpha**2 * q) / (alpha * root + 1 - alpha)
            gain = forward * xi + np.sqrt(forward**2 + (1 - xi**2) * q)
            gain, shift = gain / (forward**2 + q), xi
        else:
            alpha, beta = values
            root = np.sqrt(1 - (2 * alpha - 1) * beta * q)
            forward = (1 - beta * alpha**2 * q) / (alpha * root + 1 - alpha)
            gain, shift = 1.0, 0.0
        seen = np.stack([gain * plane[:, 0], gain * plane[:, 1], gain * forward - shift], axis=1)
        return seen / np.linalg.norm(seen, axis=1, keepdims=True)
