"""Rotations as Hamilton's unit quaternions (w, x, y, z)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def matrix_of_quaternion(quaternion: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return the rotation ``(3, 3)`` of (w, x, y, z), of any length but zero."""
    q = np.asarray(quaternion, np.float64)
    length = float(np.linalg.norm(q))
    if not 0 < length < math.inf:
        raise ValueError(f"{what}: found {q.tolist()}, expected a unit quaternion")
    w, x, y, z = (q / length).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of_matrix(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (w, x, y, z), w not negative, of a rotation ``(3, 3)``.

    The eigenvector of the largest eigenvalue of a symmetric matrix made of R: accurate for every
    angle. Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix" (2000).
    """
    trace = np.trace(R)
    w = [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
    K = np.zeros((4, 4))
    K[0, 0], K[0, 1:], K[1:, 0] = trace, w, w
    K[1:, 1:] = R + R.T - trace * np.eye(3)
    q = np.linalg.eigh(K / 3)[1][:, -1]
    return q if q[0] >= 0 else -q
