"""The pinhole nearest to a bundle of rays: approximate position, orientation and intrinsics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigs.geometry.image_checks import pixel_centres
from rigs.geometry.points import nearest_point
from rigs.geometry.rotation import upper_times_rotation

_ENOUGH = 16  # rays that determine the pinhole; fewer need a larger part of the image
_SAMPLES = 64  # rays along each side of an image
_PARALLEL = 1e-9  # certainty per ray of the nearest point; below it rays are parallel
_FAR = 1e3  # distance of the centre behind parallel rays, in spreads of their origins
_WIDEST = 0.5  # cosine of the largest angle from the mean ray; wider ones distort the fit


class NearestPinhole:
    """A camera's members that its nearest pinhole gives; ``_pinhole`` holds what is fitted."""

    @property
    def _pinhole(self) -> tuple[NDArray, NDArray, NDArray]:
        """Camera matrix, R and position of the nearest pinhole; each kind of camera fits one."""
        raise NotImplementedError

    @property
    def camera_matrix(self) -> NDArray[np.float64]:
        """Intrinsics of the nearest pinhole, ``(3, 3)``; see the notes."""
        return self._pinhole[0]

    @property
    def R(self) -> NDArray[np.float64]:  # noqa: N802
        """Rotation from world to camera axes of the nearest pinhole, ``(3, 3)``."""
        return self._pinhole[1]

    @property
    def t(self) -> NDArray[np.float64]:
        """Translation of the nearest pinhole, ``(3,)``."""
        return -self.R @ self.position

    @property
    def position(self) -> NDArray[np.float64]:
        """The point nearest to all rays, ``(3,)``; far behind parallel ones."""
        return self._pinhole[2]


def fitted_pinhole(
    name: str,
    image_size: tuple[int, int],
    rays: Callable[[NDArray[np.float64]], tuple[NDArray, NDArray]],
    in_view: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
) -> tuple[NDArray, NDArray, NDArray]:
    """Return camera matrix, R and position, read-only, of the pinhole nearest to a camera's rays.

    ``rays`` gives origins and directions ``(N, 3)`` of pixels ``(N, 2)``; ``in_view`` says which
    belong to the view that is fitted.
    """
    for part in (0.5, 1.0, None):  # lenses bend least in the middle
        uv = spread_pixels(image_size, part) if part else pixel_centres(image_size)
        origins, directions = rays(uv)
        seen = np.isfinite(directions).all(axis=1) & in_view(uv)
        if seen.sum() >= _ENOUGH:
            break
    if not seen.any():
        raise ValueError(f"camera {name}: found no pixel with a ray, expected one")
    found = nearest_pinhole(uv[seen], origins[seen], directions[seen])
    for array in found:
        array.setflags(write=False)
    return found


def spread_pixels(image_size: tuple[int, int], part: float) -> NDArray[np.float64]:
    """Return pixels ``(N, 2)`` spread over the middle ``part`` (0 to 1) of an image."""
    axes = []
    for side in image_size:
        margin = (1 - part) / 2 * (side - 1)
        steps = np.linspace(margin, side - 1 - margin, min(side, _SAMPLES))
        axes.append(np.unique(np.rint(steps)))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def nearest_pinhole(
    uv: NDArray[np.float64], origins: NDArray[np.float64], directions: NDArray[np.float64]
) -> tuple[NDArray, NDArray, NDArray]:
    """Return the camera matrix, R ``(3, 3)`` each, and the position ``(3,)``.

    The position is the point nearest to all rays; for parallel rays it is far behind their
    origins. Matrix and rotation follow from the least-squares homography from directions ``(N,
    3)`` to pixels (Hartley and Zisserman, "Multiple View Geometry", algorithms 4.1 and A4.1.1).
    Rays by a mirror have a mirrored image, which no rotation gives: its left and right are
    exchanged.
    """
    axis = _unit(directions.mean(axis=0))
    position, certainty = nearest_point(origins, directions)
    if certainty <= _PARALLEL * len(origins):
        middle = origins.mean(axis=0)
        spread = float(np.linalg.norm(origins - middle, axis=1).max()) or 1.0
        position = middle - _FAR * spread * axis
        directions = origins - position
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    ahead = directions @ axis > _WIDEST
    homography = _homography(uv[ahead], directions[ahead], axis)
    if homography is None:
        middle = uv.mean(axis=0)
        focal = max(float(np.ptp(uv)), 1.0)
        K = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
        return K, _frame(axis), position
    if np.linalg.det(homography) < 0:
        middle = uv[:, 0].min() + uv[:, 0].max()
        homography = np.array([[-1.0, 0, middle], [0, 1, 0], [0, 0, 1]]) @ homography
    K, R = upper_times_rotation(homography)
    return K / K[2, 2], R, position


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vector at length one; (0, 0, 1) for the zero vector."""
    length = np.linalg.norm(vector)
    return vector / length if length > 0 else np.array([0.0, 0.0, 1.0])


def _frame(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a rotation ``(3, 3)`` whose third row is ``axis``."""
    across = np.eye(3)[np.abs(axis).argmin()]
    right = _unit(np.cross(across, axis))
    return np.stack([right, np.cross(axis, right), axis])


def _homography(
    uv: NDArray[np.float64], directions: NDArray[np.float64], axis: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return H ``(3, 3)`` with ``[u, v, 1] ~ H d``; None where the rays do not determine one."""
    if len(uv) < 4:
        return None
    middle, spread = uv.mean(axis=0), uv.std(axis=0)
    if not (spread > 0).all():
        return None
    x, y = ((uv - middle) / spread).T[..., None]
    frame = _frame(axis)
    d = directions @ frame.T
    scale = np.array([*np.maximum(d[:, :2].std(axis=0), 1e-300), 1.0])
    d = d / scale  # well conditioned for the narrowest lens
    zero = np.zeros_like(d)
    rows = np.concatenate(
        [np.concatenate([d, zero, -x * d], axis=1), np.concatenate([zero, d, -y * d], axis=1)]
    )
    _, singular, basis = np.linalg.svd(rows.T @ rows)
    if singular[7] <= 1e-12 * singular[0]:
        return None
    H = basis[8].reshape(3, 3) / scale @ frame
    H = np.array([[spread[0], 0, middle[0]], [0, spread[1], middle[1]], [0, 0, 1]]) @ H
    return H if H[2] @ axis > 0 else -H
