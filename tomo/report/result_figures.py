"""The plots of a reconstruction's report: convergence, and difference from a truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tomo.draw.figures import INK, MUTED, new_figure, plain, short_numbers, thin_lines, with_unit
from tomo.draw.volume.planes import few_ticks, middle_planes, room_of_number, show_plane
from tomo.metrics import cosine_distance, nrmse

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

    from tomo.report.content import Convergence, Results

_LINES = ("#1f6fb2", "#c2500f", "#12826a", "#7d5ba6", "#9a7b00", "#5b6672")


def draw_convergence(history: Sequence[Convergence]) -> Figure:
    """Return relative residual, and cosine distance where known, against iteration and time."""
    known = [course for course in history if course.cosine_distance is not None]
    rows = 2 if known else 1
    figure = new_figure(9.0, 2.75 * rows + 0.35)
    panels = figure.subplots(rows, 2, squeeze=False)
    quantities = (
        ("relative_residual", "relative residual"),
        ("cosine_distance", "cosine distance"),
    )
    for (field, words), pair in zip(quantities, panels, strict=False):
        for abscissa, axes in zip(("iterations", "seconds"), pair, strict=True):
            for number, course in enumerate(history):
                values = getattr(course, field)
                if values is None:
                    continue
                x, y = np.asarray(getattr(course, abscissa)), np.asarray(values, np.float64)
                positive = np.isfinite(y) & (y > 0)
                axes.plot(
                    x[positive],
                    y[positive],
                    color=_LINES[number % len(_LINES)],
                    linestyle=("-", "--", ":")[number // len(_LINES) % 3],
                    linewidth=1.4,
                    marker="o",
                    markersize=2.6 if positive.sum() <= 60 else 0,
                    label=plain(_short(course.label)),
                )
            thin_lines(axes)
            axes.set_xlabel("iteration" if abscissa == "iterations" else "time (s)", fontsize=8)
            axes.set_ylabel(words, fontsize=8)
            axes.set_yscale("log")
            ends = [max(course.seconds) for course in history if len(course.seconds)]
            drawn = any((line.get_xdata() > 0).any() for line in axes.lines)  # no zero volumes
            far = max(ends, default=0) > 20 * min(ends, default=0) > 0
            if abscissa == "seconds" and far and drawn:
                axes.set_xscale("log")  # a slow method would squeeze the quick ones to a line
            elif abscissa == "iterations":
                axes.xaxis.get_major_locator().set_params(integer=True)
    if len(history) > 1:
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(
            handles,
            labels,
            loc="upper center",
            ncols=min(len(labels), 5),
            fontsize=8,
            frameon=False,
        )
    legend_height = 0.32 if len(history) > 1 else 0.0
    figure.tight_layout(rect=(0, 0, 1, 1 - (legend_height / figure.get_figheight())))
    return figure


def draw_difference(results: Results) -> Figure:
    """Return every volume's two upright middle planes on one scale; differences from the truth."""
    volumes = [(results.method, results.volume), *results.comparisons]
    truth = results.truth
    columns = volumes if truth is None else [("truth", truth), *volumes]
    grid, unit = results.grid, results.rig.length_unit
    extent = grid.extent
    pair = extent[0] + extent[2]
    rows = 1 if truth is None else 2
    left, right, top, between, bottom = 0.6, 0.75, 0.62, 0.42, 0.5
    gap = room_of_number(*grid.lower[[0, 2]], *grid.upper[[0, 2]])  # neighbours' last and first
    apart = gap + 0.15
    room = max(1.5, (10.4 - left - right) / len(columns)) - apart - gap
    drawn = min(room / pair, 3.4 / extent[1])
    w0, w2, h = extent[0] * drawn, extent[2] * drawn, extent[1] * drawn
    pitch = max(w0 + w2 + gap + apart, 1.5)
    width = left + pitch * len(columns) + right
    height = top + rows * h + (rows - 1) * between + bottom
    figure = new_figure(width, height)
    reference = results.volume if truth is None else truth
    highest = float(reference.max()) or 1.0
    lowest = min(0.0, float(reference.min()))
    limit = 1.0
    if truth is not None:
        errors = [np.abs(volume - truth) for _, volume in volumes]
        limit = max(float(np.quantile(e, 0.9995)) for e in errors) or 1.0
    images: dict[int, AxesImage] = {}
    for number, (label, volume) in enumerate(columns):
        x0 = left + number * pitch
        heading = _short(label)
        if truth is not None and volume is not truth:
            distance, error = cosine_distance(volume, truth), nrmse(volume, truth)
            heading += f"\ncosine distance {distance:.2g}\nNRMSE {error:.2g}"
        figure.text(
            x0 / width, (height - 0.06) / height, heading, fontsize=7.5, color=INK, va="top",
            linespacing=1.3, parse_math=False,
        )  # fmt: skip
        for row in range(rows):
            if row and volume is truth:
                continue
            shown = volume - truth if row else volume
            low, high = (-limit, limit) if row else (lowest, highest)
            y = height - top - h - row * (h + between)
            for k, (picture, w) in enumerate(
                zip(middle_planes(shown, grid), (w0, w2), strict=False)
            ):
                x = x0 + k * (w0 + gap)
                axes = figure.add_axes((x / width, y / height, w / width, h / height))
                images[row] = show_plane(
                    axes, picture, unit, lowest=low, highest=high,
                    colours="RdBu_r" if row else "inferno",
                )  # fmt: skip
                few_ticks(axes, w, h)
                first_column = number == (1 if row else 0)
                if k or not first_column:
                    axes.set_ylabel("")
                    axes.tick_params(labelleft=False)
                if row < rows - 1 and volume is not truth:
                    axes.set_xlabel("")
                    axes.tick_params(labelbottom=False)
    for row, image in images.items():
        y = height - top - h - row * (h + between)
        rect = ((width - right) / width, y / height, 0.1 / width, h / height)
        bar = figure.add_axes(rect)
        figure.colorbar(image, cax=bar)
        bar.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
        words = with_unit("difference" if row else "emission", results.value_unit)
        short_numbers(bar)
        bar.set_ylabel(plain(words), fontsize=7.5, color=INK)
    return figure


def _short(name: str, most: int = 26) -> str:
    """Return the name, cut if it is long."""
    return name if len(name) <= most else f"{name[: most - 1]}…"
