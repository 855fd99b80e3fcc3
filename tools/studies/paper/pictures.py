"""The page's pictures: convergence of each part's trainings, and sections through volumes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.common.axes import curves
from studies.common.page import significant
from studies.paper.cases import truth_of
from studies.paper.rows import ROWS, Row
from tomo.draw.figures import INK, MUTED, new_figure, plain, save_figure, short_numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Records = Mapping[str, Mapping[str, Any]]

SECTIONED = ("layouts", "views", "noise")
"""Parts whose volumes are shown."""


def pictures_of(part: str) -> tuple[str, ...]:
    """Return where a part's pictures are in the output folder."""
    kinds = ("convergence", "sections") if part in SECTIONED else ("convergence",)
    return tuple(f"paper/{part}_{kind}.png" for kind in kinds)


def draw(part: str, rows: Mapping[str, Row], records: Records, out: Path) -> None:
    """Draw a part's pictures into ``out`` from rows, in the size in which they were run."""
    own = [name for name in records if ROWS[name].part == part]
    base = ["jet"] if part == "ablation" and "jet" in records else []
    panels: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for name in (*base, *own):
        if not records[name]["art"]:
            points = [(epoch, distance) for epoch, distance, _ in records[name]["curve"]]
            panels.setdefault(records[name]["flame"], {})[name] = points
    first, *others = pictures_of(part)
    if panels:
        save_figure(curves(panels, "epoch", "cosine distance"), out / first)
    if others and own:
        _draw_sections({name: rows[name] for name in own}, records, out, out / others[0])


def _draw_sections(rows: Mapping[str, Row], records: Records, out: Path, path: Path) -> None:
    """Draw the middle plane of each row: the truth, the volume found, and their difference."""
    width = 2.1 * len(rows) + 1.6  # inches
    figure = new_figure(width, 4.2)
    left, right = 0.6 / width, 1 - 1.0 / width
    grid = figure.add_gridspec(1, len(rows), wspace=0.18, left=left, right=right, top=0.8)
    shown = {}
    for place, (name, row) in zip(grid, rows.items(), strict=True):
        truth = truth_of(row.flame, row.grid)
        found = np.load(out / "volumes" / f"{name}.npy", allow_pickle=False)
        parts = [np.asarray(part)[:, :, truth.shape[2] // 2].T for part in (truth, found)]
        three = place.subgridspec(1, 3, wspace=0.08).subplots(sharey=True)
        shown[name] = three, [part / truth.max() for part in (*parts, parts[1] - parts[0])]
        distance = significant(records[name]["cosine_distance"])
        title = f"{name.replace('-', ' ')}\ncosine distance {distance}"
        three[1].set_title(plain(title), fontsize=7, color=INK, pad=16)
    largest = max(float(np.abs(images[2]).max()) for _, images in shown.values())
    for number, (name, (three, images)) in enumerate(shown.items()):
        extent = rows[name].grid.extent / 2
        looks = [("inferno", 0, 1)] * 2 + [("RdBu_r", -largest, largest)]
        words = ("truth", "found", "difference")
        for axes, image, look, word in zip(three, images, looks, words, strict=True):
            drawn = _show(axes, image, extent, *look)
            axes.text(0.5, 1.01, word, transform=axes.transAxes, fontsize=6, color=MUTED,
                      ha="center")  # fmt: skip
            axes.tick_params(left=axes is three[0])
            if number == len(shown) - 1 and axes is not three[0]:
                low = 0.12 if axes is three[2] else 0.5
                bar = figure.colorbar(
                    drawn, cax=figure.add_axes((right + 0.2 / width, low, 0.08 / width, 0.3))
                )
                bar.ax.tick_params(labelsize=6, colors=MUTED)
                bar.set_label(
                    "difference" if axes is three[2] else "emission over its maximum", fontsize=6
                )
                short_numbers(bar.ax)
    figure.supxlabel("x (mm)", fontsize=7)
    figure.supylabel("y (mm)", fontsize=7)
    save_figure(figure, path)


def _show(axes: Axes, image: NDArray, extent: NDArray, colours: str, *limits: float) -> Any:
    box = (-extent[0], extent[0], -extent[1], extent[1])
    axes.tick_params(labelsize=6, colors=MUTED, labelleft=axes.get_subplotspec().is_first_col())
    return axes.imshow(
        image, cmap=colours, vmin=limits[0], vmax=limits[1], origin="lower", extent=box
    )
