"""The axes around a scene: a floor, three edges with ticks, numbers and units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.draw import shapes
from tomo.draw.scene import Colour, Mesh, Scene, rgb
from tomo.draw.viewpoint import Viewpoint

ON_WHITE, ON_BLACK = (rgb("#5b6672"), rgb("#e6e9ed")), (rgb("#7d8792"), rgb("#262c33"))
"""Colours of edges and floor."""

NAMES = "xyz"
EYE = (28.0, 25.0)  # azimuth and elevation in degrees from which pictures are taken


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


def tick_values(
    lower: float, upper: float, at_most: int
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
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
    bounds: NDArray[np.float64],
    viewpoint: Viewpoint,
    up: Up,
    length_unit: str,
    spacing: float = 70,
) -> tuple[Axis, ...]:
    """Return the three edges of the box ``bounds`` ``(2, 3)`` that do not cover its contents.

    The two level axes lie along the front edges of the floor, the upward one along the left
    silhouette. Ticks are about ``spacing`` pixels apart.
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
        count = int(np.linalg.norm(pixels[1] - pixels[0]) // spacing)
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
    for axis, along in zip(axes[:2], up.level, strict=True):
        across = next(a for a in up.level if a != along)
        starts, ends = axis.positions.copy(), axis.positions.copy()
        starts[:, across], ends[:, across] = bounds[:, across]
        border = np.repeat(np.where(np.arange(3) == up.axis, floor, bounds[0])[None], 2, axis=0)
        border_end = border.copy()
        border[:, along] = bounds[:, along]
        border_end[:, along] = bounds[:, along]
        border_end[:, across] = bounds[1, across]
        lines.append(
            shapes.tubes(np.vstack([starts, border]), np.vstack([ends, border_end]), 0.6 * pixel)
        )
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
