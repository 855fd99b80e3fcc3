"""The lens of an image that was turned: the camera turns about its axis, and the lens with it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigs.lens.distortion import Distortion
from rigs.lens.perspective import sensor_rotation

_VECTORS = ((3, 2), (8, 10), (9, 11))  # coefficients that are x and y: p2 p1, s1 s3, s2 s4


def turned(
    distortion: Distortion, linear: NDArray[np.float64]
) -> tuple[NDArray[np.float64], Distortion, NDArray[np.float64]]:
    """Return a lens and a turn about the axis that together give a turned image.

    Parameters
    ----------
    distortion : Distortion
        ``D``, which maps directions to the image plane.
    linear : (2, 2) float64
        ``A`` of the turned image's pixels ``A D(x) + c``; its determinant is positive.

    Returns
    -------
    upper : (2, 2) float64
        ``U`` of the new camera matrix, upper triangular with positive diagonal.
    distortion : Distortion
        ``D'``, of the same model.
    turn : (2, 2) float64
        ``Q``, by which the camera turns about its axis: ``A D(x) = U D'(Q x)`` for every ``x``.

    Notes
    -----
    ``A = U G`` with a rotation ``G``. Radial terms do not change when the image plane turns;
    tangential and thin prism terms are vectors that turn along (``p2, p1``; ``s1, s3``;
    ``s2, s4``). A sensor tilted by ``R = Ry(tau_y) Rx(tau_x)`` maps the plane by ``P(R) R``, where
    ``P`` depends on R's third column only. ``G P(R) R = P(G R) G R``, and ``G R = R' Q`` with
    tilts ``R'`` anew, so ``G P(R) R = P(R') R' Q``: the tilts change, and turn the camera by
    another angle than ``G``.
    """
    below = linear[1] / math.hypot(*linear[1])
    G = np.array([[below[1], -below[0]], below])
    upper = linear @ G.T
    upper[1, 0] = 0.0  # but for rounding
    coefficients = list(distortion.coefficients)
    turn = G
    if distortion.model == "tilted" and any(coefficients[12:]):
        R = sensor_rotation(*coefficients[12:])
        R[:2] = G @ R[:2]
        row = R[1, :2] / math.hypot(*R[1, :2])
        turn = np.array([[row[1], -row[0]], row])  # R' = G R Q^T has no entry in row 1, column 0
        R[:, :2] = R[:, :2] @ turn.T
        coefficients[12:] = math.atan2(R[1, 2], R[1, 1]), math.atan2(R[2, 0], R[0, 0])
    if distortion.model != "fisheye":
        for pair in _VECTORS:
            if pair[1] < len(coefficients):
                x, y = turn @ [coefficients[i] for i in pair]
                coefficients[pair[0]], coefficients[pair[1]] = x + 0.0, y + 0.0  # no -0
    return upper, Distortion(distortion.model, tuple(coefficients)), turn
