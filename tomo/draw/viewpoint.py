"""The viewpoint of a picture: a plain perspective camera for drawing, not for measuring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """An eye that looks at a target; pixel centres at integers, rows downward.

    Attributes
    ----------
    eye : (3,) float64
    axes : (3, 3) float64
        Rows: right, down, forward, as unit vectors of the world.
    focal : float
        Focal length in pixels.
    principal : (2,) float64
        Pixel that the forward direction meets.
    size : (int, int)
        Width and height of the picture in pixels.
    """

    eye: NDArray[np.float64]
    axes: NDArray[np.float64]
    focal: float
    principal: NDArray[np.float64]
    size: tuple[int, int]

    @classmethod
    def framing(
        cls,
        points: ArrayLike,
        toward: ArrayLike,
        up: ArrayLike,
        size: tuple[int, int],
        margins: tuple[float, float, float, float] = (0.08, 0.08, 0.08, 0.08),
        distance: float = 3.5,
    ) -> Viewpoint:
        """Return the viewpoint from which ``points`` fill the picture inside the margins.

        Parameters
        ----------
        points : (N, 3)
            World coordinates that the picture must contain.
        toward, up : (3,)
            World directions from the points to the eye, and upward.
        size : (int, int)
            Width and height in pixels.
        margins : (left, right, top, bottom)
            Fractions of the width and the height that stay free.
        distance : float
            Distance of the eye in radii of the points. Large values approach parallel projection.
        """
        points = np.asarray(points, np.float64).reshape(-1, 3)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = float(np.linalg.norm(points - middle, axis=1).max()) or 1.0
        forward = -np.asarray(toward, np.float64) / np.linalg.norm(toward)
        right = np.cross(forward, np.asarray(up, np.float64))
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(forward, right), forward])
        eye = middle - forward * radius * distance
        seen = (points - eye) @ axes.T
        plane = seen[:, :2] / seen[:, 2:]
        lower, upper = plane.min(axis=0), plane.max(axis=0)
        left, right_margin, top, bottom = margins
        free = np.array([(1 - left - right_margin) * size[0], (1 - top - bottom) * size[1]])
        focal = float((free / np.maximum(upper - lower, 1e-9)).min())
        corner = np.array([left * size[0], top * size[1]])
        principal = corner + free / 2 - focal * (lower + upper) / 2 - 0.5
        return cls(eye, axes, focal, principal, (int(size[0]), int(size[1])))

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the pixels ``(N, 2)`` of ``points`` ``(N, 3)``; NaN behind the eye."""
        seen = (np.asarray(points, np.float64).reshape(-1, 3) - self.eye) @ self.axes.T
        depth = np.where(seen[:, 2:] > 0, seen[:, 2:], np.nan)
        return self.focal * seen[:, :2] / depth + self.principal

    def directions(self, uv: NDArray) -> NDArray[np.float64]:
        """Return unit world directions ``(N, 3)`` through the pixels ``uv`` ``(N, 2)``."""
        plane = (uv - self.principal) / self.focal
        directions = plane @ self.axes[:2] + self.axes[2]
        return directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def pixel_at(self, point: ArrayLike) -> float:
        """Return the world length of one pixel at ``point`` ``(3,)``."""
        return float((np.asarray(point, np.float64) - self.eye) @ self.axes[2]) / self.focal
