"""Rotations: checked matrices, vectors, angles, quaternions; the best motion between points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

_EXACT = 1e-14  # deviation from orthonormal up to which a rotation is kept bit by bit


def numbers(value: ArrayLike, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    """Return ``value`` as a read-only, finite float64 array of ``shape``; errors name ``what``."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{what}: found {value!r}, expected {_wording(shape)}") from None
    if array.shape != shape:
        raise ValueError(f"{what}: found shape {array.shape}, expected {_wording(shape)}")
    if not np.isfinite(array).all():
        raise ValueError(f"{what}: found NaN or infinity, expected finite numbers")
    array.setflags(write=False)
    return array


def rotation(value: ArrayLike, what: str, tolerance: float = 1e-6) -> NDArray[np.float64]:
    """Return ``value`` as a read-only rotation matrix ``(3, 3)``; a mirrored one is refused.

    Within ``tolerance`` of orthonormal (largest entry of ``R R^T - 1``) it is replaced by the
    nearest rotation, so that rays and projections agree to the last digits. A matrix that is
    orthonormal to 1e-14 is kept bit by bit.
    """
    R = numbers(value, (3, 3), what)
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = float(np.abs(R @ R.T - np.eye(3)).max())
    if not deviation <= tolerance:
        raise ValueError(
            f"{what}: not orthonormal (R times its transpose is off the identity by "
            f"{deviation:.2g}), expected a rotation within {tolerance:g}"
        )
    if np.linalg.det(R) < 0:
        raise ValueError(f"{what}: mirrored (determinant -1), expected a rotation (+1)")
    if deviation <= _EXACT:
        return R
    left, _, right = np.linalg.svd(R)
    nearest = left @ right
    nearest.setflags(write=False)
    return nearest


def matrix_of_vector(vector: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation ``(..., 3, 3)`` of rotation vectors ``(..., 3)``, OpenCV's rvec.

    A rotation vector is the axis times the angle in radians.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


def matrix_of_angles(x: float, y: float, z: float) -> NDArray[np.float64]:
    """Return the rotation ``Rx(x) Ry(y) Rz(z)``, ``(3, 3)``, of angles in radians."""
    (sx, sy, sz), (cx, cy, cz) = np.sin([x, y, z]), np.cos([x, y, z])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def matrix_of_quaternion(quaternion: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return the rotation ``(3, 3)`` of Hamilton's (w, x, y, z), of any length but zero."""
    from scipy.spatial.transform import Rotation

    q = np.asarray(quaternion, np.float64)
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(q))
    if not 0 < length < np.inf:
        raise ValueError(f"{what}: found {q.tolist()}, expected a unit quaternion")
    return Rotation.from_quat(np.roll(q, -1)).as_matrix()


def quaternion_of_matrix(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Hamilton's unit quaternion (w, x, y, z), w not negative, of a rotation ``(3, 3)``."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(R).as_quat(canonical=True), 1)


def upper_times_rotation(matrix: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Return K, upper triangular with a positive diagonal, and R of the matrix ``K R``.

    R is orthonormal, and a rotation where the matrix's determinant is positive.
    """
    q, r = np.linalg.qr(matrix[::-1].T)
    K, R = r.T[::-1, ::-1], q.T[::-1]
    signs = np.sign(np.diag(K))
    return K * signs, signs[:, None] * R


def _wording(shape: tuple[int, ...]) -> str:
    """Return the words for an array of numbers of ``shape``."""
    return f"{' x '.join(str(n) for n in shape)} numbers"


POORLY_MET = 0.05
"""Misfit, relative to the RMS distance of given points from their middle, that is worth a word."""

_ON_A_LINE = 1e-6  # second spread over the first, below which points fix no turn about their line


def motion_between(
    points: NDArray[np.float64], onto: NDArray[np.float64], rescale: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return R, t and s of ``onto = s R points + t``, best in least squares over ``(N, 3)``.

    On a line R is one of many; s is 1 without ``rescale``; R is never mirrored (Umeyama,
    "Least-squares estimation of transformation parameters between two point patterns", 1991).
    """
    middle, there = points.mean(axis=0), onto.mean(axis=0)
    left, values, right = np.linalg.svd((onto - there).T @ (points - middle))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    R = left @ (sign[:, None] * right)
    size = float((values * sign).sum() / ((points - middle) ** 2).sum()) if rescale else 1.0
    return R, there - size * R @ middle, size


def are_on_a_line(points: NDArray[np.float64]) -> bool:
    """Return whether points ``(N, 3)`` lie on a line, as two always do."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(points) < 3 or bool(spread[1] <= _ON_A_LINE * spread[0])
