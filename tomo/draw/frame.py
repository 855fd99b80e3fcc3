"""Where a picture is seen from, and the axes around its scene: a floor, three edges, ticks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.draw import shapes
from tomo.draw.scene import Colour, Mesh, Scene, rgb

ON_WHITE, ON_BLACK = (rgb("#5b6672"), rgb("#e6e9ed")), (rgb("#7d8792"), rgb("#262c33"))
"""Colours of edges and floor."""

NAMES = "xyz"

EYE = (28.0, 25.0)  # azimuth and elevation in degrees from which pictures are taken


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """An eye that looks at a target, for drawing, not for measuring; pixel centres at integers.

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
        """Return the viewpoint from which ``points`` ``(N, 3)`` fill the picture in its margins.

        World directions ``(3,)`` lead ``toward`` the eye, and ``up``. Margins are left, right, top
        and bottom, fractions of the ``size``, width and height in pixels. The ``distance`` of the
        eye is in radii of the points; large ones approach parallel projection.
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

    def pixel_at(self, point: ArrayLike) -> float:
        """Return the world length of one pixel at ``point`` ``(3,)``."""
        return float((np.asarray(point, np.float64) - self.eye) @ self.axes[2]) / self.focal


@dataclass(frozen=True)
class Up:
    """Which world axis points upward in pictures: 0, 1, 2 for x, y, z and a sign."""

    axis: int = 1
    sign: int = 1

    @property
    def vector(self) -> NDArray[np.float64]:
        """Return the upward unit vector, ``(3,)``."""
        return np.eye(3)[self.axis] * self.sign

    @property
    def level(self) -> tuple[int, int]:
        """Return the two level axes, in right-handed order with the upward axis."""
        return (self.axis + 1) % 3, (self.axis + 2) % 3

    def eye_direction(self, azimuth: float, elevation: float) -> NDArray[np.float64]:
        """Return the direction to an eye, angles in degrees, azimuth from the first level axis."""
        first, second = self.level
        a, e = np.radians([azimuth, elevation])
        direction = self.vector * np.sin(e)
        direction[first], direction[second] = np.cos(e) * np.cos(a), np.cos(e) * np.sin(a)
        return direction


UP = Up()
"""Upward along y, where nothing says otherwise."""


@dataclass(frozen=True, eq=False)
class Axis:
    """One edge with ticks: the ticks' positions, their texts, and the direction of the texts."""

    title: str
    edge: NDArray[np.float64]  # (2, 3)
    positions: NDArray[np.float64]  # (ticks, 3)
    texts: tuple[str, ...]
    outward: NDArray[np.float64]  # (3,)


def tick_values(lower: float, upper: float, at_most: int) -> tuple[NDArray, tuple[str, ...]]:
    """Return round values within ``lower..upper`` and their texts."""
    from matplotlib.ticker import MaxNLocator

    locator = MaxNLocator(nbins=max(at_most, 1), steps=[1, 2, 2.5, 5, 10])
    values = np.asarray(locator.tick_values(lower, upper), np.float64)
    slack = 1e-9 * (upper - lower)
    values = values[(values >= lower - slack) & (values <= upper + slack)]
    values = np.where(np.abs(values) < 1e-9 * max(abs(lower), abs(upper)), 0.0, values)
    texts = tuple(f"{v:.10g}".replace("-", "\N{MINUS SIGN}") for v in values)
    return values, texts


def axes_around(
    bounds: NDArray[np.float64], viewpoint: Viewpoint, up: Up, length_unit: str
) -> tuple[Axis, ...]:
    """Return the three edges of the box ``bounds`` ``(2, 3)`` that do not cover its contents.

    The two level axes lie along the front edges of the floor, the upward one along the left
    silhouette.
    """
    first, second = up.level
    middle = bounds.mean(axis=0)
    to_eye = viewpoint.eye - middle
    near = np.where(to_eye > 0, bounds[1], bounds[0])
    floor = bounds[0, up.axis] if up.sign > 0 else bounds[1, up.axis]
    made = []
    for along, across in ((first, second), (second, first)):
        edge = np.zeros((2, 3))
        edge[:, along], edge[:, across], edge[:, up.axis] = bounds[:, along], near[across], floor
        made.append((along, edge, np.eye(3)[across] * np.sign(near[across] - middle[across])))
    edges = []
    for axis, other in ((first, second), (second, first)):
        edge = np.zeros((2, 3))
        edge[:, up.axis] = bounds[:, up.axis]
        edge[:, axis], edge[:, other] = near[axis], bounds.sum(axis=0)[other] - near[other]
        edges.append(edge)
    edge = min(edges, key=lambda e: viewpoint.project(e)[:, 0].mean())
    made.append((up.axis, edge, -viewpoint.axes[0]))
    axes = []
    for along, edge, outward in made:
        pixels = viewpoint.project(edge)
        count = int(np.linalg.norm(pixels[1] - pixels[0]) // 70)  # about so far apart
        lower, upper = edge[:, along]
        values, texts = tick_values(lower, upper, at_most=min(count, 6))
        positions = np.repeat(edge[:1], len(values), axis=0)
        positions[:, along] = values
        axes.append(Axis(f"{NAMES[along]} ({length_unit})", edge, positions, texts, outward))
    return tuple(axes)


def frame_scene(
    bounds: NDArray[np.float64],
    axes: tuple[Axis, ...],
    viewpoint: Viewpoint,
    up: Up,
    colours: tuple[Colour, Colour] = ON_WHITE,
) -> Scene:
    """Return the floor's grid, the three edges and their ticks as thin tubes."""
    pixel = viewpoint.pixel_at(bounds.mean(axis=0))
    floor = bounds[0, up.axis] if up.sign > 0 else bounds[1, up.axis]
    lines = []
    for axis, along, across in zip(axes[:2], up.level, up.level[::-1], strict=True):
        border = np.repeat(np.where(np.arange(3) == up.axis, floor, bounds[0])[None], 2, axis=0)
        border[:, along] = bounds[:, along]
        starts = np.vstack([axis.positions, border])
        ends = starts.copy()
        starts[:, across], ends[:, across] = bounds[:, across]
        lines.append(shapes.tubes(starts, ends, 0.6 * pixel))
    ticks = [
        shapes.tubes(a.positions, a.positions + a.outward * 6 * pixel, 0.7 * pixel)
        for a in axes
        if len(a.positions)
    ]
    edges = [shapes.tubes(a.edge[:1], a.edge[1:], 0.9 * pixel) for a in axes]
    return Scene(
        (
            Mesh("floor", "floor", *shapes.join(lines), colours[1]),
            Mesh("axes", "axes", *shapes.join([*edges, *ticks]), colours[0]),
        )
    )
