"""The plots of a reconstruction's report: views, convergence, and difference from a truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw.figures import INK, MUTED, new_figure, plain, short_numbers, thin_lines, with_unit
from tomo.draw.volume.planes import few_ticks, middle_planes, room_of_number, show_plane
from tomo.metrics import cosine_distance, nrmse
from tomo.pipeline.answer import worst_view

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

    from tomo.pipeline.view import View
    from tomo.report.content import Convergence, Results

_LINES = ("#1f6fb2", "#c2500f", "#12826a", "#7d5ba6", "#9a7b00", "#5b6672")
_UNUSED = "#b9c0c7"
_MOST_VIEWS = 6
# A line of pixels stays visible at this many inches, though no longer to scale.
_THINNEST = 0.15


def views_to_show(views: Sequence[View], most: int = _MOST_VIEWS) -> list[View]:
    """Return views that took no part, the least explained one, then others evenly spread."""
    apart = [view for view in views if not view.takes_part]
    others = [view for view in views if view.takes_part]
    worst = worst_view(others)
    first = apart[: most - 1] + ([] if worst is None else [worst])
    others = [view for view in others if view is not worst]
    free = min(most - len(first), len(others))
    spread = np.round(np.arange(free) * len(others) / max(free, 1)).astype(int)
    return first + [others[i] for i in spread]


def draw_views(views: Sequence[View]) -> Figure:
    """Return measured, re-projected and residual images, in per cent of each view's maximum."""
    shown = views_to_show(views)
    aspect = float(np.median([v.measured.shape[1] / v.measured.shape[0] for v in shown]))
    across = min(len(shown), 3 if aspect < 0.8 else 2)
    down = math.ceil(len(shown) / across)
    width, pad, bar_room, heading = 10.4, 0.28, 0.72, 0.52
    image_width = (width / across - pad) / 3 - 0.04
    image_height = min(max(image_width / aspect, _THINNEST), 4.2)
    image_width = min(image_width, max(image_height * aspect, _THINNEST))
    height = down * (image_height + heading) + bar_room
    figure = new_figure(width, height)
    scaled = [_in_percent(view) for view in shown]
    spread = [np.abs(r[np.isfinite(r)]) for _, _, r in scaled]
    limit = max((float(np.quantile(s, 0.995)) for s in spread if s.size), default=0.0) or 1.0
    block = 3 * (image_width + 0.04) + pad
    images: tuple[AxesImage, ...] = ()
    for number, (view, parts) in enumerate(zip(shown, scaled, strict=True)):
        row, column = divmod(number, across)
        x0 = pad / 2 + column * block
        top = height - row * (image_height + heading) - heading
        ends = ((0, 100, "inferno"), (0, 100, "inferno"), (-limit, limit, "RdBu_r"))
        own_width, own_height = _inside(image_width, image_height, view.measured.shape)
        drawn = []
        for k, (part, (low, high, colours)) in enumerate(zip(parts, ends, strict=True)):
            x = x0 + k * (image_width + 0.04)
            rect = (x / width, (top - own_height) / height, own_width / width,
                    own_height / height)  # fmt: skip
            axes = figure.add_axes(rect)
            axes.set_facecolor(_UNUSED)
            drawn.append(axes.imshow(part, vmin=low, vmax=high, cmap=colours, aspect="auto"))
            axes.set_xticks([])
            axes.set_yticks([])
            for spine in axes.spines.values():
                spine.set(color="#c3cad1", linewidth=0.5)
            words = ("measured", "re-projected", "difference")[k]
            axes.set_title(words, fontsize=6.5, color=MUTED, pad=2.5)
        images = drawn[0], drawn[2]
        residual = view.relative_residual
        role = ", held out" if view.held_out else ", excluded" if view.excluded else ""
        figure.text(
            x0 / width,
            (top + 0.28) / height,
            f"{_short(view.name)}{role}: residual {residual:.1%}, noise {view.relative_noise:.1%}",
            fontsize=8,
            weight="bold" if role else "normal",
            color="#c2500f" if role else INK,
            parse_math=False,
        )
    quantities = ("image, % of the view's maximum", "difference, % of the view's maximum")
    for k, image in enumerate(images):
        rect = ((pad / 2 + k * 3.4) / width, 0.36 / height, 2.6 / width, 0.09 / height)
        bar = figure.add_axes(rect)
        figure.colorbar(image, cax=bar, orientation="horizontal")
        bar.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
        bar.set_xlabel(quantities[k], fontsize=7, color=INK, labelpad=2)
    return figure


def _inside(width: float, height: float, shape: tuple[int, int]) -> tuple[float, float]:
    """Return the largest sides, in inches, of an image (rows, columns) to scale in a panel."""
    rows, columns = shape
    scale = min(width / columns, height / rows)
    return max(columns * scale, _THINNEST), max(rows * scale, _THINNEST)


def _in_percent(view: View) -> tuple[NDArray, NDArray, NDArray]:
    """Return measured, re-projected and residual images; unusable pixels are NaN."""
    usable = view.usable
    measured = np.where(usable, view.measured, np.nan).astype(np.float64)
    reprojected = np.where(usable, view.reprojected, np.nan).astype(np.float64)
    highest = float(np.quantile(measured[usable], 0.9995)) if usable.any() else 0.0
    scale = 100 / (highest if highest > 0 else 1.0)
    return measured * scale, reprojected * scale, (reprojected - measured) * scale


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
