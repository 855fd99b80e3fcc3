"""What the studies' plots share: looks, lines, logarithmic axes, and one legend for all panels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from tomo.draw.figures import INK, new_figure, plain, thin_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINES = ("#1f6fb2", "#12826a", "#7d5ba6", "#9a7b00", "#a3466a", "#5b6672")
STYLES = ("-", "--", ":")
MOST_DOTS = 40

Points = Sequence[tuple[float, float]]


def looks_of(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return a colour and a line style for each name."""
    return {
        name: (LINES[n % len(LINES)], STYLES[n // len(LINES) % len(STYLES)])
        for n, name in enumerate(names)
    }


def curves(
    panels: Mapping[str, Mapping[str, Points]],
    x: str,
    y: str,
    most_abreast: int = 2,
    marks: Mapping[str, str] | None = None,
) -> Figure:
    """Return panels of curves on logarithmic axes, with one legend above.

    ``panels`` have by title the points of each curve by name; those not above zero are not drawn.
    Names in ``marks`` are shown as large dark markers of that form, without lines.
    """
    marks = marks or {}
    abreast = min(len(panels), most_abreast)
    down = math.ceil(len(panels) / abreast)
    figure = new_figure(5.2 * abreast if abreast > 1 else 6.4, 2.9 * down + 0.9)
    grid = figure.subplots(down, abreast, squeeze=False)
    look = looks_of(sorted({name for panel in panels.values() for name in panel} - set(marks)))
    for axes, (title, panel) in zip(grid.ravel(), panels.items(), strict=False):
        for name, points in panel.items():
            shown = [(a, b) for a, b in points if a > 0 and b > 0 and math.isfinite(b)]
            colour, style = (INK, "none") if name in marks else look[name]
            dots = 6 if name in marks else 3 if len(shown) <= MOST_DOTS else 0
            axes.plot(
                *zip(*shown, strict=True), color=colour, linestyle=style, linewidth=1.4,
                marker=marks.get(name, "o"), markersize=dots, label=plain(name),
            ) if shown else None  # fmt: skip
        log_log(axes)
        axes.set_title(plain(title), fontsize=8.5, color=INK)
        axes.set_xlabel(x, fontsize=8)
        axes.set_ylabel(y, fontsize=8)
    for axes in grid.ravel()[len(panels) :]:
        axes.set_visible(False)
    shared_legend(figure, grid)
    return figure


def log_log(axes: Axes, room: float = 0.05) -> None:
    """Give a plot logarithmic axes, thin grey lines, and numbers a reader can read."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for name in "xy":
        axis = getattr(axes, f"{name}axis")
        axes.set(**{f"{name}scale": "log"})
        axes.margins(**{name: room})
        low, high = axes.get_xlim() if name == "x" else axes.get_ylim()
        narrow = high / low < 300
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    thin_lines(axes)


def shared_legend(figure: Figure, panels: Sequence[Sequence[Axes]], across: int = 5) -> None:
    """Put one legend above all panels."""
    handles: dict[str, Any] = {}
    for row in panels:
        for axes in row:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(label, handle)
    widest = 0.5 + 0.055 * max(map(len, handles), default=0)  # inches, at this size of letters
    columns = max(1, min(len(handles), across, int(figure.get_figwidth() / widest)))
    lines = math.ceil(len(handles) / columns)
    figure.legend(
        handles.values(), handles.keys(), loc="upper center", ncols=columns,
        fontsize=7.5, frameon=False,
    )  # fmt: skip
    figure.set_figheight(figure.get_figheight() + 0.2 * max(0, lines - 3))
    figure.tight_layout(rect=(0, 0, 1, 1 - (0.1 + 0.2 * lines) / figure.get_figheight()))
