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

#: Parameters before the focal lengths and the principal point.
PARAMETERS = {"omni": ("xi",), "ds": ("xi", "alpha"), "eucm": ("alpha", "beta")}


def directions(
    model: str, parameters: Sequence[float], plane: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return unit vectors ``(N, 3)`` seen at ``plane`` ``(N, 2)``, in focal lengths; or NaN."""
    q = (plane**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        if model == "omni":
            (xi,) = parameters
            gain, forward, shift = (xi + np.sqrt(1 + (1 - xi**2) * q)) / (q + 1), 1.0, xi
        elif model == "ds":
            xi, alpha = parameters
            root = np.sqrt(1 - (2 * alpha - 1) * q)
            forward = (1 - alpha**2 * q) / (alpha * root + 1 - alpha)
            gain = forward * xi + np.sqrt(forward**2 + (1 - xi**2) * q)
            gain, shift = gain / (forward**2 + q), xi
        else:
            alpha, beta = parameters
            root = np.sqrt(1 - (2 * alpha - 1) * beta * q)
            forward = (1 - beta * alpha**2 * q) / (alpha * root + 1 - alpha)
            gain, shift = 1.0, 0.0
        seen = np.stack([gain * plane[:, 0], gain * plane[:, 1], gain * forward - shift], axis=1)
        return seen / np.linalg.norm(seen, axis=1, keepdims=True)
