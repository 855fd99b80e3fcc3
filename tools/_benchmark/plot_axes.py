"""What the benchmark's plots share: looks, lines, logarithmic axes, and one legend for all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tomo.draw.figures import thin_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINES = ("#1f6fb2", "#12826a", "#7d5ba6", "#9a7b00", "#a3466a", "#5b6672")
STYLES = ("-", "--", ":")


def looks_of(methods: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return a colour and a line style for each method, in alphabetical order."""
    return {
        method: (LINES[n % len(LINES)], STYLES[n // len(LINES) % len(STYLES)])
        for n, method in enumerate(sorted(methods))
    }


def draw_course(
    axes: Axes, course: Sequence, label: str, look: tuple[str, str], dot: float = 5
) -> None:
    """Draw cosine distance against seconds; the start says nothing, the best has a dot."""
    x, y = [entry[0] for entry in course[1:]], [entry[1] for entry in course[1:]]
    if not y:
        return
    draw_line(axes, x, y, label, look, marker_size=0)
    best = min(range(len(y)), key=y.__getitem__)
    axes.plot(x[best], y[best], "o", color=look[0], markersize=dot)


def draw_line(
    axes: Axes,
    x: Sequence[float],
    y: Sequence[float],
    label: str,
    look: tuple[str, str],
    marker_size: float = 3,
) -> None:
    colour, style = look
    axes.plot(
        x, y, color=colour, linestyle=style, linewidth=1.4, marker="o", markersize=marker_size,
        label=label,
    )  # fmt: skip


def log_log(axes: Axes, room: float = 0.05, names: str = "xy") -> None:
    """Give a plot logarithmic axes, thin grey lines, and numbers a reader can read."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for name in names:
        axis = getattr(axes, f"{name}axis")
        axes.set(**{f"{name}scale": "log"})
        axes.margins(**{name: room})
        low, high = axes.get_xlim() if name == "x" else axes.get_ylim()
        narrow = high / low < 300
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    thin_lines(axes)


def own_ticks(axes: Axes, values: Sequence[float]) -> None:
    """Set the x axis's ticks to the values measured."""
    from matplotlib.ticker import FixedLocator, NullLocator

    axes.xaxis.set_major_locator(FixedLocator(values))
    axes.xaxis.set_minor_locator(NullLocator())


def name_axes(panels: Sequence[Sequence[Axes]], x_words: str, y_words: str) -> None:
    """Name the axes on the outer panels only."""
    for axes in panels[-1]:
        axes.set_xlabel(x_words, fontsize=8)
    for row in panels:
        row[0].set_ylabel(y_words, fontsize=8)


def shared_legend(figure: Figure, panels: Sequence[Sequence[Axes]]) -> None:
    """Put one legend above all panels."""
    handles: dict[str, Any] = {}
    for row in panels:
        for axes in row:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(label, handle)
    across = 6
    lines = math.ceil(len(handles) / across)
    figure.legend(
        handles.values(), handles.keys(), loc="upper center", ncols=min(len(handles), across),
        fontsize=8, frameon=False,
    )  # fmt: skip
    figure.tight_layout(rect=(0, 0, 1, 1 - (0.1 + 0.2 * lines) / figure.get_figheight()))
