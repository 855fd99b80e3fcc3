"""How far every row is from its bound, and the curves that figures came from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from _benchmark.plot_axes import draw_line, log_log, looks_of

from _stress import AREAS
from tomo.draw.figures import INK, MUTED, new_figure, plain, thin_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OVERALL = ""
"""Stands for the plot of all areas among the areas' own."""

_WITHIN, _BEYOND = "#12826a", "#b3261e"
_MOST_DECADES = 8.0
_MOST_DOTS = 40


def plots(areas: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Callable[[], Figure]]]:
    """Return, for each area that has some, what draws its figures, by name; the overall first."""
    found: dict[str, dict[str, Callable[[], Figure]]] = {}
    if areas:
        found[OVERALL] = {"margins": partial(_margins, areas)}
    for area, record in areas.items():
        charts = [row["chart"] for row in record["rows"] if row["chart"]]
        if charts:
            found[area] = {
                f"{area}_{number}": partial(_curves, chart)
                for number, chart in enumerate(charts, 1)
            }
    return found


def decades_within(row: Mapping[str, Any]) -> float | None:
    """Return ``log10`` of how many times a row is within its bound; None where that says nothing.

    A bound of zero, a count of faults, has no such ratio.
    """
    figure, bound = float(row["figure"]), float(row["bound"])
    if not math.isfinite(figure) or not math.isfinite(bound) or bound <= 0:
        return None
    if figure <= 0:
        return -_MOST_DECADES if row["at_least"] else _MOST_DECADES
    decades = math.log10(bound / figure) * (-1 if row["at_least"] else 1)
    return max(-_MOST_DECADES, min(_MOST_DECADES, decades))


def _margins(areas: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Return one dot a row: how many powers of ten it is within its bound."""
    names = list(areas)
    figure = new_figure(8.4, 0.9 + 0.34 * len(names))
    axes = figure.subplots()
    for height, name in enumerate(reversed(names)):
        rows = areas[name]["rows"]
        marked = [(decades_within(row), row["holds"]) for row in rows]
        for holds, colour in ((True, _WITHIN), (False, _BEYOND)):
            at = [decades for decades, held in marked if held is holds and decades is not None]
            axes.plot(at, [height] * len(at), "o", color=colour, alpha=0.55, markersize=5)
    axes.axvline(0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(names)), [AREAS[name] for name in reversed(names)])
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xlabel(
        "powers of ten within the bound, 8 for more (left of the line: beyond it)\n"
        "counts of faults, whose bound is 0, are not shown",
        fontsize=7.5,
        color=MUTED,
    )
    thin_lines(axes)
    figure.tight_layout()
    return figure


def _curves(chart: Mapping[str, Any]) -> Figure:
    figure = new_figure(7.4, 4.0)
    axes = figure.subplots()
    look = looks_of(list(chart["curves"]))
    for name, points in chart["curves"].items():
        drawn = _above_zero(points)
        x, y = [point[0] for point in drawn], [point[1] for point in drawn]
        dots = 3 if len(drawn) <= _MOST_DOTS else 0
        draw_line(axes, x, y, plain(name), look[name], marker_size=dots)
    log_log(axes)
    axes.set_title(plain(chart["title"]), fontsize=9, color=INK)
    axes.set_xlabel(plain(chart["x"]), fontsize=8)
    axes.set_ylabel(plain(chart["y"]), fontsize=8)
    axes.legend(fontsize=7.5, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    figure.tight_layout()
    return figure


def _above_zero(points: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    return [(x, y) for x, y in points if x > 0 and y > 0 and math.isfinite(y)]
