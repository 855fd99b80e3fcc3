"""The plots of a report: convergence, differences, uncertainty, learned weights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw.emission import COLOURS
from tomo.draw.figures import INK, MUTED, new_figure, plain, thin_lines, with_unit
from tomo.draw.scene import ColourScale
from tomo.draw.volume.planes import Slices, draw_slices, middle_planes
from tomo.grid import Volume
from tomo.metrics import cosine_distance, nrmse
from tomo.solvers import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tomo.pipeline import Reconstruction
    from tomo.pipeline.learned_weights import LearnedWeights, Profile

_LINES = ("#1f6fb2", "#c2500f", "#12826a", "#7d5ba6", "#9a7b00", "#5b6672")
_LEARNED, _PLAIN, _LIGHT = "#1f6fb2", "#b9c0c7", "#e6eaee"


def draw_convergence(history: Sequence[Solution]) -> Figure:
    """Return relative residual, and distance from a truth where known, by iteration and time."""
    known = any(one.distance is not None for course in history for one in course.history)
    rows = [("relative_residual", "relative residual")]
    rows += [("distance", "cosine distance")] * known
    figure = new_figure(9.0, 2.75 * len(rows) + 0.35)
    figure.set_layout_engine("constrained")
    panels = figure.subplots(len(rows), 2, squeeze=False)
    for (field, words), pair in zip(rows, panels, strict=True):
        for abscissa, axes in zip(("index", "seconds"), pair, strict=True):
            for number, course in enumerate(history):
                places = np.array([getattr(one, abscissa) for one in course.history])
                values = np.array([getattr(one, field) for one in course.history], np.float64)
                positive = np.isfinite(values) & (values > 0)
                axes.plot(
                    places[positive],
                    values[positive],
                    color=_LINES[number % len(_LINES)],
                    linestyle=("-", "--", ":")[number // len(_LINES) % 3],
                    linewidth=1.4,
                    marker="o",
                    markersize=2.6 if positive.sum() <= 60 else 0,
                    label=plain(_short(method_of(course))),
                )
            thin_lines(axes)
            axes.set_xlabel("iteration" if abscissa == "index" else "time (s)", fontsize=8)
            axes.set_ylabel(words, fontsize=8)
            axes.set_yscale("log")
            ends = [max(one.seconds for one in own.history) for own in history if own.history]
            drawn = any((line.get_xdata() > 0).any() for line in axes.lines)  # no zero volumes
            far = max(ends, default=0) > 20 * min(ends, default=0) > 0
            if abscissa == "seconds" and far and drawn:
                axes.set_xscale("log")  # a slow method would squeeze the quick ones to a line
            elif abscissa == "index":
                axes.xaxis.get_major_locator().set_params(integer=True)
    if len(history) > 1:
        handles = panels[0][0].get_lines()
        figure.legend(handles=handles, loc="outside upper center", ncols=min(len(handles), 5),
                      fontsize=8, frameon=False)  # fmt: skip
    return figure


def draw_difference(outcome: Reconstruction) -> Figure:
    """Return the planes of every volume on one scale, beside them what differs from the truth."""
    volume = seen_volume(outcome)
    made = [(method_of(one), volume.like(one.volume))
            for one in (outcome.solution, *outcome.comparisons)]  # fmt: skip
    reference = volume if outcome.truth is None else volume.like(outcome.truth)
    scale = ColourScale(
        with_unit("emission", volume.value_unit),
        min(0.0, float(reference.min())),
        float(reference.max()) or 1.0,
        COLOURS,
    )
    if outcome.truth is None:
        return draw_slices([Slices(_short(name), one, scale) for name, one in made])
    errors = [one - reference for _, one in made]
    limit = max(float(np.quantile(np.abs(one), 0.9995)) for one in errors) or 1.0
    less = ColourScale(with_unit("difference", volume.value_unit), -limit, limit, "RdBu_r")
    cells: list[Slices | None] = [Slices("truth", reference, scale), None]
    for (name, one), error in zip(made, errors, strict=True):
        distance = cosine_distance(one, reference)
        words = f"cosine distance {distance:.2g}, NRMSE {nrmse(one, reference):.2g}"
        cells += [Slices(_short(name), one, scale), Slices(words, error, less)]
    return draw_slices(cells, columns=2)


def draw_deviations(
    volume: Volume, deviation: NDArray | None, title: str = "Standard deviation"
) -> Figure:
    """Return the middle planes of a volume and, beside them, of its standard deviation, if any.

    ``deviation`` ``(nx, ny, nz)`` in the volume's unit has a colour scale of its own, and the
    ``title``.
    """
    shown = [("Emission", volume)]
    if deviation is not None:
        shown.append((title, volume.like(deviation)))
    cells = []
    for name, values in shown:
        clean = values.like(np.nan_to_num(np.asarray(values)))
        highest = max(float(plane.values.max()) for plane in middle_planes(clean)) or 1.0
        cells.append(Slices(name, clean, ColourScale(volume.value_unit, 0.0, highest, COLOURS)))
    return draw_slices(cells, columns=len(cells))


def draw_learned(learned: LearnedWeights, length_unit: str) -> Figure:
    """Return a figure of the mean relative weights, and of left-out pixels' residuals."""
    figure = new_figure(10.4, 3.0)
    figure.set_layout_engine("constrained")
    *panels, last = figure.subplots(1, len(learned.profiles) + 1)
    units = {"length": length_unit, "root mean square pixel": "typical pixels"}
    for axes, profile in zip(panels, learned.profiles, strict=True):
        _draw_profile(axes, profile)
        axes.set_xlabel(f"{profile.quantity} ({units.get(profile.unit, profile.unit)})")
    panels[0].set_ylabel("weight / segment length", fontsize=8)
    # one scale for all, so that small differences look small
    weights = np.concatenate([profile.weight for profile in learned.profiles])
    low, high = min(np.nanmin(weights), 0.95), max(np.nanmax(weights), 1.05)
    room = 0.06 * (high - low)
    for axes in panels:
        axes.set_ylim(low - room, high + room)
        axes.axhline(1.0, color=MUTED, linewidth=0.7)
    _draw_residuals(last, learned)
    for axes in (*panels, last):
        thin_lines(axes)
        axes.xaxis.label.set_size(8)
    last.grid(False)
    words = f"learned weights: spread {learned.spread:.1%}"
    figure.suptitle(words, fontsize=8.5, color=INK, x=0.012, ha="left")
    return figure


def _draw_profile(axes: Axes, profile: Profile) -> None:
    """Draw the means, and behind them the fraction of the light in each bin."""
    axes.plot(profile.centre, profile.weight, "o-", color=_LEARNED, markersize=2.6, linewidth=1.5)
    behind = axes.twinx()
    behind.bar(profile.centre, profile.light, np.diff(profile.edges), color=_LIGHT)
    behind.set_ylim(0, 3 * max(profile.light.max(), 1e-9))
    behind.set_axis_off()
    axes.set_zorder(behind.get_zorder() + 1)
    axes.patch.set_visible(False)
    lit = np.flatnonzero(np.isfinite(profile.weight))
    if len(lit):
        axes.set_xlim(profile.edges[lit[0]], profile.edges[lit[-1] + 1])


def _draw_residuals(axes: Axes, learned: LearnedWeights) -> None:
    names = {"learned": ("learned\nweights", _LEARNED),
             "segment_lengths": ("segment\nlengths", _PLAIN)}  # fmt: skip
    found = learned.held_out_residual
    known = [name for name in names if math.isfinite(found.get(name, math.nan))]
    for row, name in enumerate(known):
        axes.barh(row, found[name], 0.5, color=names[name][1])
        axes.text(found[name], row, f" {found[name]:.2%}", va="center", fontsize=8, color=INK)
    axes.set_yticks(range(len(known)), [names[name][0] for name in known], fontsize=8)
    axes.set_xlabel("relative residual of left-out pixels", fontsize=8)
    axes.set_xlim(0, 1.25 * max((found[name] for name in known), default=1.0))
    axes.set_ylim(-0.9, len(known) - 0.1)
    axes.xaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")


def seen_volume(outcome: Reconstruction) -> Volume:
    """Return the volume as pictures show it: a value in every voxel, with its units."""
    return outcome.volume.like(outcome.solution.volume)


def method_of(solution: Solution) -> str:
    """Return the name of the method that found a volume."""
    return str(solution.settings.get("method", "reconstruction"))


def _short(name: str, most: int = 26) -> str:
    """Return the name, cut if it is long."""
    return name if len(name) <= most else f"{name[: most - 1]}…"
