"""A still picture of a scene on matplotlib axes, with coordinate axes and labels."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw import frame
from tomo.draw.emission import LIGHT, Looks, emission_image, end_of_scale, of_integral
from tomo.draw.figures import INK, LIGHT_INK, LIGHT_MUTED, MUTED
from tomo.draw.frame import Viewpoint
from tomo.draw.raster import render
from tomo.draw.scene import ColourScale, Scene
from tomo.grid import Volume

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

_TURNS = (0.0, 25.0, -25.0, 50.0, -50.0, 80.0, -80.0, 120.0, -120.0, 180.0)  # degrees
_REACHES = (1.0, 2.5, 4.5, 7.0, 10.0)  # in gaps


@dataclass
class LabelPlacer:
    """Places texts one by one on ``axes``, whose data coordinates are pixels, rows downward.

    Each text is placed as near to its anchor as the earlier texts allow. A text far from its
    anchor gets a thin line to it. A text without a free position is omitted. ``halo`` is the
    ground's colour.
    """

    axes: Axes
    size: tuple[int, int]
    halo: str = "white"
    taken: list[Bbox] = field(default_factory=list)

    def place(
        self,
        text: str,
        anchor: np.ndarray,
        outward: np.ndarray,
        *,
        gap: float,
        colour: tuple | str = "#1b2733",
        fontsize: float = 8.0,
        leader: bool = True,
        turns: tuple[float, ...] = _TURNS,
        reaches: tuple[float, ...] = _REACHES,
    ) -> bool:
        """Write ``text`` near pixel ``anchor``, moved ``outward``; return whether it fits."""
        from matplotlib.patheffects import withStroke
        from matplotlib.transforms import Bbox

        norm = float(np.linalg.norm(outward))
        if not (np.isfinite(anchor).all() and math.isfinite(norm)):
            return False
        base = math.atan2(outward[1], outward[0]) if norm > 1e-9 else -math.pi / 2
        written = self.axes.text(
            0, 0, text, fontsize=fontsize, color=colour, ha="center", va="center", zorder=6,
            parse_math=False,
        )  # fmt: skip
        extent = written.get_window_extent().transformed(self.axes.transData.inverted())
        half = np.abs(extent.size) / 2
        tries = sorted(
            itertools.product(reaches, turns), key=lambda t: t[0] / 2.5 + abs(t[1]) / 25
        )
        for reach, turn in tries:
            angle = base + math.radians(turn)
            way = np.array([math.cos(angle), math.sin(angle)])
            # the text's box touches the circle of radius reach * gap from outside
            centre = anchor + way * reach * gap + way * (np.abs(way) @ half)
            low, high = centre - half - (4, 1), centre + half + (4, 1)
            box = Bbox([low, high])
            is_inside = (low >= 0).all() and (high <= self.size).all()
            if is_inside and not any(box.overlaps(other) for other in self.taken):
                written.set_position(centre)
                written.set_path_effects([withStroke(linewidth=1.8, foreground=self.halo)])
                self.taken.append(box)
                if leader and reach * gap > 14:
                    near = anchor + way * (reach * gap - 1)
                    self.axes.plot(
                        [anchor[0], near[0]], [anchor[1], near[1]], color="#8a95a1", lw=0.5
                    )
                return True
        written.remove()
        return False


def panel(figure: Figure, rect: tuple) -> tuple[Axes, tuple[int, int]]:
    """Return axes whose data coordinates are the pixels of the finished picture, and its size."""
    axes = figure.add_axes(rect)
    width, height = (
        round(fraction * inches * figure.dpi)
        for fraction, inches in zip(rect[2:], figure.get_size_inches(), strict=True)
    )
    axes.set_axis_off()
    return axes, (width, height)


def show_scene(
    axes: Axes,
    scene: Scene,
    viewpoint: Viewpoint,
    bounds: NDArray,
    up: frame.Up,
    light: NDArray | None = None,
) -> LabelPlacer:
    """Draw the scene with its axes round ``bounds`` and write their numbers.

    The ground is white, or black where ``light``, ``(height, width, 3)``, is added to the scene.
    """
    around = frame.axes_around(bounds, viewpoint, up, scene.length_unit)
    on_white = light is None
    ink, muted = (INK, MUTED) if on_white else (LIGHT_INK, LIGHT_MUTED)
    lines = frame.ON_WHITE if on_white else frame.ON_BLACK
    edges = frame.frame_scene(bounds, around, viewpoint, up, lines)
    if light is None:
        picture = render(scene + edges, viewpoint)
    else:
        picture = render(scene.on_black() + edges, viewpoint, ground=(0.0, 0.0, 0.0)) + light
    axes.imshow(np.clip(picture, 0, 1), interpolation="none")
    width, height = viewpoint.size
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    placer = LabelPlacer(axes, viewpoint.size, "white" if on_white else "black")
    middle = viewpoint.project(bounds.mean(axis=0))[0]
    pixel = viewpoint.pixel_at(bounds.mean(axis=0))
    for axis in around:
        edge, centre = viewpoint.project(axis.edge), axis.edge.mean(axis=0)
        ends = viewpoint.project(np.stack([centre, centre + axis.outward * pixel]))
        outward = ends[1] - ends[0]
        normal = np.array([edge[0, 1] - edge[1, 1], edge[1, 0] - edge[0, 0]])
        normal *= np.sign(normal @ (edge.mean(axis=0) - middle)) or 1.0
        turns = (0.0, 12.0, -12.0)
        for position, text in zip(axis.positions, axis.texts, strict=True):
            tick = viewpoint.project(position + axis.outward * 6 * pixel)[0]
            placer.place(
                text, tick, outward, gap=7, fontsize=7, colour=muted, leader=False, turns=turns
            )
        placer.place(
            axis.title, edge.mean(axis=0), normal, gap=32, fontsize=8, colour=ink, leader=False,
            turns=(0.0, 15.0, -15.0, 40.0, -40.0, 65.0, -65.0, 90.0, -90.0),
            reaches=(1.0, 1.3, 1.6, 2.0, 2.5, 3.0),
        )  # fmt: skip
    return placer


def show_light(
    axes: Axes,
    volume: Volume,
    scene: Scene,
    viewpoint: Viewpoint,
    bounds: NDArray,
    *,
    up: frame.Up,
    looks: Looks = LIGHT,
    full: float | None = None,
) -> LabelPlacer:
    """Draw a volume's light and a scene on black, with axes round ``bounds`` and a colour bar.

    Surfaces on white where the looks ask for them. ``full`` is the end of the colours, a round
    number above the brightest pixel when None.
    """
    if looks.levels:
        from tomo.draw.volume.isosurface import isosurface_scene

        scene = isosurface_scene(volume, looks.levels) + scene
        words = ", ".join(f"{100 * level:g}" for level in looks.levels)
        axes.text(0.02, 1.0, f"Surfaces at {words} % of the maximum", fontsize=7, color=INK,
                  va="bottom", transform=axes.transAxes)  # fmt: skip
        return show_scene(axes, scene, viewpoint, bounds, up)
    integrals = emission_image(volume, viewpoint)
    full = full or end_of_scale(float(integrals.max()))
    scale = ColourScale(
        of_integral(volume.value_unit, volume.length_unit), 0.0, full, looks.colours
    )
    light = scale(integrals)
    placer = show_scene(axes, scene, viewpoint, bounds, up, light)
    dpi = axes.figure.dpi
    tall = 0.3 * viewpoint.size[1]
    bar = axes.inset_axes((0.1 * dpi, 0.34 * dpi, 0.09 * dpi, tall), transform=axes.transData)
    ramp = scale(np.linspace(full, 0, 256))[:, None]
    bar.imshow(ramp, aspect="auto", extent=(0, 1, 0, full))
    bar.set_xticks([])
    bar.yaxis.tick_right()
    bar.locator_params(axis="y", nbins=5)
    bar.tick_params(labelsize=6.5, colors=LIGHT_MUTED, length=2, pad=2)
    for spine in bar.spines.values():
        spine.set(color="#3a424b", linewidth=0.6)
    axes.text(
        0.1 * dpi, 0.16 * dpi, f"light ({scale.title})", fontsize=7, color=LIGHT_INK, va="center",
        parse_math=False,
    )  # fmt: skip
    return placer


def write_names(placer: LabelPlacer, scene: Scene, viewpoint: Viewpoint, size: float) -> None:
    """Write the scene's labels, the ones nearest to the eye first."""
    labels = sorted(scene.labels, key=lambda label: np.linalg.norm(label.position - viewpoint.eye))
    for label in labels:
        pixel = viewpoint.pixel_at(label.position)
        outward = label.outward / max(float(np.linalg.norm(label.outward)), 1e-300)
        ends = viewpoint.project(np.stack([label.position, label.position + outward * pixel]))
        placer.place(
            label.text, ends[0], ends[1] - ends[0], gap=4, fontsize=size, colour=label.colour
        )
