"""Rows as plots: error against seconds, and growth, on logarithmic axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from tomo.view.figures import INK, MUTED, new_figure, thin_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = Mapping[str, Any]

_DEFAULT = "#c2500f"
_LINES = ("#1f6fb2", "#12826a", "#7d5ba6", "#9a7b00", "#a3466a", "#5b6672")
_STYLES = ("-", "--", ":")
_NOISES = {
    "clean": "clean",
    "gaussian": "10 % Gaussian noise",
    "poisson": "1000 photons at the maximum",
}


def plots(studies: Mapping[str, Sequence[Row]]) -> dict[str, dict[str, Figure]]:
    """Return, for each study, its figures by name."""
    found: dict[str, dict[str, Figure]] = {}
    runs = studies.get("solvers") or ()
    flames = list(dict.fromkeys(row["flame"] for row in runs))
    if flames:
        found["solvers_mean"] = {
            f"solvers_{flame}": _solvers([row for row in runs if row["flame"] == flame])
            for flame in flames
        }
    for name, draw in _DRAWN.items():
        rows = [row for row in studies.get(name) or () if not row.get("skipped")]
        if rows:
            found[name] = {name: draw(rows)}
    return found


def _solvers(rows: Sequence[Row]) -> Figure:
    """Return cosine distance against seconds: a panel for each noise and number of views."""
    noises = list(dict.fromkeys(row["noise"] for row in rows))
    views = list(dict.fromkeys(row["views"] for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows if row["method"] != "auto"))
    look = _looks(methods)
    width, height = 10.4, 2.9 * len(noises) + 0.75
    figure = new_figure(width, height)
    panels = figure.subplots(len(noises), len(views), squeeze=False, sharex="col", sharey="row")
    first_seed = min(row["seed"] for row in rows)
    for axes_row, noise in zip(panels, noises, strict=True):
        for axes, count in zip(axes_row, views, strict=True):
            shown = [
                row
                for row in rows
                if (row["noise"], row["views"], row["seed"]) == (noise, count, first_seed)
            ]
            for row in shown:
                if row["course"]:
                    _course(axes, row["course"], row["method"], look[row["method"]])
            for row in shown:
                if row["method"] == "auto":
                    axes.plot(
                        row["seconds"], row["cosine_distance"], "*", markersize=13,
                        color=_DEFAULT, markeredgecolor="white", zorder=5, label="auto",
                    )  # fmt: skip
            axes.set_title(f"{count} views, {_NOISES.get(noise, noise)}", fontsize=8.5, color=INK)
            _log_log(axes)
    _label(panels, "seconds since the images were in memory", "cosine distance from the truth")
    _legend(figure, panels)
    return figure


def _consistent(rows: Sequence[Row]) -> Figure:
    """Return cosine distance against seconds for exact data: a panel for each flame."""
    flames = list(dict.fromkeys(row["flame"] for row in rows))
    look = _looks(list(dict.fromkeys(row["method"] for row in rows)))
    figure = new_figure(10.4 if len(flames) > 1 else 6.2, 4.0)
    panels = figure.subplots(1, len(flames), squeeze=False, sharey=True)
    for axes, flame in zip(panels[0], flames, strict=True):
        for row in rows:
            if row["flame"] == flame:
                colour, _ = look[row["method"]]
                label = f"{row['method']}{'' if row['skip'] else ', nothing skipped'}"
                _course(axes, row["course"], label, (colour, "-" if row["skip"] else "--"), dot=0)
        axes.set_title(f"{flame}, 33 views, exact data", fontsize=8.5, color=INK)
        for level in (1e-3, 1e-6):
            axes.axhline(level, color=MUTED, linewidth=0.6, zorder=0)
        _log_log(axes)
    _label(panels, "seconds since the images were in memory", "cosine distance from the truth")
    _legend(figure, panels)
    return figure


def _skipping(rows: Sequence[Row]) -> Figure:
    """Return where each method ends, with and without skipping, joined by a line."""
    cases = list(dict.fromkeys((row["flame"], row["noise"]) for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    look = _looks([method for method in methods if method != "auto"])
    down = math.ceil(len(cases) / 2)
    figure = new_figure(10.4, 2.9 * down + 0.75)
    panels = figure.subplots(down, min(len(cases), 2), squeeze=False)
    for axes, (flame, noise) in zip(panels.ravel(), cases, strict=False):
        for method in methods:
            pair = {
                row["skip"]: row
                for row in rows
                if (row["flame"], row["noise"], row["method"]) == (flame, noise, method)
            }
            colour = look[method][0] if method in look else _DEFAULT
            x = [pair[skip]["seconds"] for skip in (False, True)]
            y = [pair[skip]["cosine_distance"] for skip in (False, True)]
            axes.plot(x, y, color=colour, linewidth=1.2)
            axes.plot(x[0], y[0], "o", color="white", markeredgecolor=colour, markersize=7)
            axes.plot(x[1], y[1], "o", color=colour, markersize=7, label=method)
        axes.plot(
            [], [], "o", color="white", markeredgecolor=MUTED, markersize=7,
            label="hollow: nothing skipped",
        )  # fmt: skip
        axes.set_title(f"{flame}, 33 views, {_NOISES.get(noise, noise)}", fontsize=8.5, color=INK)
        _log_log(axes, room=0.25)
    for axes in panels.ravel()[len(cases) :]:
        axes.set_visible(False)
    _label(panels, "seconds since the images were in memory", "cosine distance from the truth")
    _legend(figure, panels)
    return figure


def _growth(along: str, words: str) -> Callable[[Sequence[Row]], Figure]:
    """Return what draws time and memory against the grid's edge or the number of views."""

    def draw(rows: Sequence[Row]) -> Figure:
        figure = new_figure(10.4, 4.1)
        time, memory = panels = figure.subplots(1, 2)
        forms = list(dict.fromkeys(row["form"] for row in rows))
        for form, colour in zip(forms, _LINES, strict=False):
            mine = [row for row in rows if row["form"] == form]
            x = [row[along] for row in mine]
            for key, style in (("trace", ":"), ("forward", "-"), ("adjoint", "--")):
                y = [row[f"{key}_seconds"] for row in mine]
                label = f"{form}: {'set-up' if key == 'trace' else key}"
                _line(time, x, y, label, (colour, style))
            _line(memory, x, [row["peak_bytes"] / 2**20 for row in mine], form, (colour, "-"))
        some = {row[along]: row["needed_bytes"] / 2**20 for row in rows}
        label = "images + two volumes"
        _line(memory, list(some), list(some.values()), label, (MUTED, ":"))
        for axes, y_words in zip(panels, ("seconds", "peak memory (MiB)"), strict=True):
            _log_log(axes)
            _own_ticks(axes, sorted({row[along] for row in rows}))
            axes.set_xlabel(words, fontsize=8)
            axes.set_ylabel(y_words, fontsize=8)
            axes.legend(fontsize=7.5, frameon=False, handlelength=3.2)
        figure.tight_layout()
        return figure

    return draw


def _threads(rows: Sequence[Row]) -> Figure:
    """Return how many times faster each product is with more threads."""
    figure = new_figure(6.2, 4.0)
    axes = figure.subplots()
    forms = list(dict.fromkeys(row["form"] for row in rows))
    for form, colour in zip(forms, _LINES, strict=False):
        for product, style in (("forward", "-"), ("adjoint", "--")):
            mine = [row for row in rows if (row["form"], row["product"]) == (form, product)]
            x, y = ([row[key] for row in mine] for key in ("threads", "speed_up"))
            _line(axes, x, y, f"{form}: {product}", (colour, style))
    counts = sorted({row["threads"] for row in rows})
    _line(axes, counts, counts, "ideal", (MUTED, ":"))
    _log_log(axes)
    _own_ticks(axes, counts)
    axes.set_xlabel("threads", fontsize=8)
    axes.set_ylabel("times faster than one", fontsize=8)
    axes.legend(fontsize=7.5, frameon=False, handlelength=3.2)
    figure.tight_layout()
    return figure


def _projectors(rows: Sequence[Row]) -> Figure:
    """Return rays a second and thread: a panel for each size."""
    sizes = list(dict.fromkeys((row["voxels"], row["views"]) for row in rows))
    figure = new_figure(10.4, 3.4)
    panels = figure.subplots(1, len(sizes), squeeze=False)
    for axes, size in zip(panels[0], sizes, strict=True):
        mine = [row for row in rows if (row["voxels"], row["views"]) == size]
        names = list(dict.fromkeys(row["what"] for row in mine))
        for row in mine:
            rate = row["rays_per_second"] / row["threads"] / 1e6
            ours = row["what"].startswith(("on the fly", "stored", "march"))
            colour = _LINES[0] if ours else MUTED
            face = colour if row["threads"] == 1 else "white"
            axes.plot(
                rate, names.index(row["what"]), "o", color=face, markeredgecolor=colour,
                markersize=7,
            )  # fmt: skip
        _log_log(axes, room=0.15)
        axes.set_yscale("linear")
        axes.set_yticks(range(len(names)), names, fontsize=7.5)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_title(f"{size[0]}^3 voxels, {size[1]} views", fontsize=8.5, color=INK)
        axes.set_xlabel("million rays a second and thread", fontsize=8)
    figure.text(
        0.995, 0.985, "filled: one thread; hollow: several", fontsize=7.5, color=MUTED,
        ha="right", va="top",
    )  # fmt: skip
    figure.tight_layout(rect=(0, 0, 1, 0.95))
    return figure


_DRAWN: Mapping[str, Callable[[Sequence[Row]], Figure]] = {
    "projectors": _projectors,
    "consistent": _consistent,
    "skipping": _skipping,
    "scaling_edge": _growth("edge", "voxels along the grid's edge"),
    "scaling_views": _growth("views", "views"),
    "threads": _threads,
}


def _looks(methods: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return a colour and a line style for each method, in alphabetical order."""
    return {
        method: (_LINES[n % len(_LINES)], _STYLES[n // len(_LINES) % len(_STYLES)])
        for n, method in enumerate(sorted(methods))
    }


def _course(
    axes: Axes, course: Sequence, label: str, look: tuple[str, str], dot: float = 5
) -> None:
    """Draw cosine distance against seconds; the start says nothing, the best has a dot."""
    x, y = [entry[0] for entry in course[1:]], [entry[1] for entry in course[1:]]
    if not y:
        return
    _line(axes, x, y, label, look, marker_size=0)
    best = min(range(len(y)), key=y.__getitem__)
    axes.plot(x[best], y[best], "o", color=look[0], markersize=dot)


def _line(
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


def _log_log(axes: Axes, room: float = 0.05) -> None:
    """Give a plot logarithmic axes, thin grey lines, and numbers a reader can read."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis, name in ((axes.xaxis, "x"), (axes.yaxis, "y")):
        axes.set(**{f"{name}scale": "log"})
        axes.margins(**{name: room})
        low, high = axes.get_xlim() if name == "x" else axes.get_ylim()
        narrow = high / low < 300
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    thin_lines(axes)


def _own_ticks(axes: Axes, values: Sequence[float]) -> None:
    """Set the x axis's ticks to the values measured."""
    from matplotlib.ticker import FixedLocator, NullLocator

    axes.xaxis.set_major_locator(FixedLocator(values))
    axes.xaxis.set_minor_locator(NullLocator())


def _label(panels: Sequence[Sequence[Axes]], x_words: str, y_words: str) -> None:
    """Name the axes on the outer panels only."""
    for axes in panels[-1]:
        axes.set_xlabel(x_words, fontsize=8)
    for row in panels:
        row[0].set_ylabel(y_words, fontsize=8)


def _legend(figure: Figure, panels: Sequence[Sequence[Axes]]) -> None:
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
