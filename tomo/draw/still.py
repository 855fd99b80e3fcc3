"""A still picture of a scene on matplotlib axes, with coordinate axes and labels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw import frame
from tomo.draw.figures import INK, MUTED
from tomo.draw.labels import LabelPlacer
from tomo.draw.raycast import render
from tomo.draw.scene import Scene
from tomo.draw.viewpoint import Viewpoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def show_scene(
    axes: Axes, scene: Scene, viewpoint: Viewpoint, bounds: NDArray, up: frame.Up, supersample: int
) -> LabelPlacer:
    """Draw the scene with its axes round ``bounds`` and write their numbers."""
    around = frame.axes_around(bounds, viewpoint, up, scene.length_unit)
    drawn = scene + frame.frame_scene(bounds, around, viewpoint, up)
    axes.imshow(render(drawn, viewpoint, supersample), interpolation="none")
    width, height = viewpoint.size
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    placer = LabelPlacer(axes, viewpoint.size)
    middle = viewpoint.project(bounds.mean(axis=0))[0]
    for axis in around:
        pixel = viewpoint.pixel_at(bounds.mean(axis=0))
        edge = viewpoint.project(axis.edge)
        outward = viewpoint.project(axis.edge.mean(axis=0) + axis.outward * pixel)[0]
        outward -= viewpoint.project(axis.edge.mean(axis=0))[0]
        normal = np.array([edge[0, 1] - edge[1, 1], edge[1, 0] - edge[0, 0]])
        normal *= np.sign(normal @ (edge.mean(axis=0) - middle)) or 1.0
        turns = (0.0, 12.0, -12.0)
        for position, text in zip(axis.positions, axis.texts, strict=True):
            tick = viewpoint.project(position + axis.outward * 6 * pixel)[0]
            placer.place(
                text, tick, outward, gap=7, fontsize=7, colour=MUTED, leader=False, turns=turns
            )
        placer.place(
            axis.title,
            edge.mean(axis=0),
            normal,
            gap=32,
            turns=(0.0, 15.0, -15.0, 40.0, -40.0, 65.0, -65.0, 90.0, -90.0),
            reaches=(1.0, 1.3, 1.6, 2.0, 2.5, 3.0),
            fontsize=8,
            colour=INK,
            leader=False,
        )
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
