"""Cameras by their axes, and published lens formulas, to hold the readers of files against.

A camera is known here by its centre and three unit vectors of the world, so that no test writes
and reads a rotation by the same matrix.
"""

from dataclasses import dataclass

import numpy as np

#: Of a lens of each of our models, in OpenCV's order.
COEFFICIENTS = {
    "none": (),
    "brown": (-0.21, 0.08, 0.001, -0.002, 0.03),
    "rational": (0.4, -0.3, 0.001, -0.0005, 0.02, 0.6, -0.1, 0.01),
    "thin_prism": (0.1, -0.05, 0.001, 0.002, 0, 0.2, 0, 0, 0.002, -0.001, 0.001, 0.0005),
    "tilted": (-0.1, 0.02, 0.001, 0.002, 0, 0, 0, 0, 0.001, 0, 0.001, 0, 0.02, -0.01),
    "fisheye": (0.02, -0.01, 0.003, -0.001),
}


@dataclass(frozen=True)
class Truth:
    """A pinhole: focal lengths and principal point in pixels whose centres are at integers."""

    centre: np.ndarray
    right: np.ndarray
    down: np.ndarray
    forward: np.ndarray
    fx: float = 803.5
    fy: float = 790.25
    cx: float = 321.3
    cy: float = 238.4
    size: tuple[int, int] = (640, 480)

    def plane(self, points):
        """The tangents ``(N, 2)`` of points to the right and down."""
        from_centre = np.asarray(points) - self.centre
        depth = from_centre @ self.forward
        return (
            np.stack([from_centre @ self.right, from_centre @ self.down], axis=1) / depth[:, None]
        )

    def pixels(self, points, lens=lambda plane: plane):
        """The pixels of points by a lens that bends the plane of tangents."""
        return lens(self.plane(points)) * [self.fx, self.fy] + [self.cx, self.cy]

    def world_to_camera(self):
        return np.stack([self.right, self.down, self.forward])

    def camera_to_world(self):
        motion = np.eye(4)
        motion[:3] = np.column_stack([self.right, self.down, self.forward, self.centre])
        return motion


def looking(centre, at=(3.0, -2, 5), up=(0.1, 1.0, 0.2), **values):
    """A camera at a place that looks at another."""
    centre = np.array(centre, float)
    forward = np.array(at) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return Truth(centre, right, np.cross(forward, right), forward, **values)


TRUTHS = (
    looking((10, 40, 300)),
    looking((260, 30, 150), fx=655.0, fy=661.5, cx=300.1, cy=251.7),
    looking((-250, 60, 170), fx=910.0, fy=905.0, cx=330.0, cy=229.0),
)


def brown(k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0, k4=0.0):
    """Brown's lens as OpenCV's documentation has it, with a term of the eighth power."""

    def lens(plane):
        x, y = plane.T
        q = x**2 + y**2
        gain = 1 + k1 * q + k2 * q**2 + k3 * q**3 + k4 * q**4
        return np.stack(
            [
                x * gain + 2 * p1 * x * y + p2 * (q + 2 * x**2),
                y * gain + p1 * (q + 2 * y**2) + 2 * p2 * x * y,
            ],
            axis=1,
        )

    return lens


def fisheye(*k):
    """Kannala and Brandt's lens: the angle to the axis and odd powers of it."""

    def lens(plane):
        r = np.linalg.norm(plane, axis=1, keepdims=True)
        angle = np.arctan(r)
        bent = angle + sum(value * angle ** (2 * n + 3) for n, value in enumerate(k))
        return plane / r * bent

    return lens
