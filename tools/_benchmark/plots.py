"""Rows as plots: error against seconds, and growth, on logarithmic axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from _benchmark.plot_axes import (
    LINES,
    draw_course,
    draw_line,
    log_log,
    looks_of,
    name_axes,
    own_ticks,
    shared_legend,
)
from tomo.draw.figures import INK, MUTED, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]

_DEFAULT = "#c2500f"
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
    look = looks_of(methods)
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
                    draw_course(axes, row["course"], row["method"], look[row["method"]])
            for row in shown:
                if row["method"] == "auto":
                    axes.plot(
                        row["seconds"], row["cosine_distance"], "*", markersize=13,
                        color=_DEFAULT, markeredgecolor="white", zorder=5, label="auto",
                    )  # fmt: skip
            axes.set_title(f"{count} views, {_NOISES.get(noise, noise)}", fontsize=8.5, color=INK)
            log_log(axes)
    name_axes(panels, "seconds since the images were in memory", "cosine distance from the truth")
    shared_legend(figure, panels)
    return figure


def _consistent(rows: Sequence[Row]) -> Figure:
    """Return cosine distance against seconds for exact data: a panel for each flame."""
    flames = list(dict.fromkeys(row["flame"] for row in rows))
    look = looks_of(list(dict.fromkeys(row["method"] for row in rows)))
    figure = new_figure(10.4 if len(flames) > 1 else 6.2, 4.0)
    panels = figure.subplots(1, len(flames), squeeze=False, sharey=True)
    for axes, flame in zip(panels[0], flames, strict=True):
        for row in rows:
            if row["flame"] == flame:
                colour, _ = look[row["method"]]
                label = f"{row['method']}{'' if row['skip'] else ', nothing skipped'}"
                draw_course(
                    axes, row["course"], label, (colour, "-" if row["skip"] else "--"), dot=0
                )
        axes.set_title(f"{flame}, 33 views, exact data", fontsize=8.5, color=INK)
        for level in (1e-3, 1e-6):
            axes.axhline(level, color=MUTED, linewidth=0.6, zorder=0)
        log_log(axes)
    name_axes(panels, "seconds since the images were in memory", "cosine distance from the truth")
    shared_legend(figure, panels)
    return figure


def _skipping(rows: Sequence[Row]) -> Figure:
    """Return where each method ends, with and without skipping, joined by a line."""
    cases = list(dict.fromkeys((row["flame"], row["noise"]) for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    look = looks_of([method for method in methods if method != "auto"])
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
        log_log(axes, room=0.25)
    for axes in panels.ravel()[len(cases) :]:
        axes.set_visible(False)
    name_axes(panels, "seconds since the images were in memory", "cosine distance from the truth")
    shared_legend(figure, panels)
    return figure


def _growth(along: str, words: str) -> Callable[[Sequence[Row]], Figure]:
    """Return what draws time and memory against the grid's edge or the number of views."""

    def draw(rows: Sequence[Row]) -> Figure:
        figure = new_figure(10.4, 4.1)
        time, memory = panels = figure.subplots(1, 2)
        forms = list(dict.fromkeys(row["form"] for row in rows))
        for form, colour in zip(forms, LINES, strict=False):
            mine = [row for row in rows if row["form"] == form]
            x = [row[along] for row in mine]
            for key, style in (("trace", ":"), ("forward", "-"), ("adjoint", "--")):
                y = [row[f"{key}_seconds"] for row in mine]
                label = f"{form}: {'set-up' if key == 'trace' else key}"
                draw_line(time, x, y, label, (colour, style))
            draw_line(memory, x, [row["peak_bytes"] / 2**20 for row in mine], form, (colour, "-"))
        some = {row[along]: row["needed_bytes"] / 2**20 for row in rows}
        label = "images + two volumes"
        draw_line(memory, list(some), list(some.values()), label, (MUTED, ":"))
        for axes, y_words in zip(panels, ("seconds", "peak memory (MiB)"), strict=True):
            log_log(axes)
            own_ticks(axes, sorted({row[along] for row in rows}))
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
    for form, colour in zip(forms, LINES, strict=False):
        of_form = [row for row in rows if row["form"] == form]
        products = dict.fromkeys(row["product"] for row in of_form)
        for product, style in zip(products, ("-", "--", ":"), strict=False):
            mine = [row for row in of_form if row["product"] == product]
            x, y = ([row[key] for row in mine] for key in ("threads", "speed_up"))
            draw_line(axes, x, y, f"{form}: {product}", (colour, style))
    counts = sorted({row["threads"] for row in rows})
    draw_line(axes, counts, counts, "ideal", (MUTED, ":"))
    log_log(axes)
    own_ticks(axes, counts)
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
            colour = LINES[0] if ours else MUTED
            face = colour if row["threads"] == 1 else "white"
            axes.plot(
                rate, names.index(row["what"]), "o", color=face, markeredgecolor=colour,
                markersize=7,
            )  # fmt: skip
        log_log(axes, room=0.15)
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


def _mismatch(rows: Sequence[Row]) -> Figure:
    """Return how near to the truth each effect lets methods come: a panel for each scene."""
    scenes = list(dict.fromkeys((row["flame"], row["noise"]) for row in rows))
    effects = list(dict.fromkeys(row["effect"] for row in rows))
    down = math.ceil(len(scenes) / 2)
    figure = new_figure(10.4, max((0.32 * len(effects) + 0.6) * down + 0.6, 3.4))
    panels = figure.subplots(down, min(len(scenes), 2), squeeze=False, sharey=True, sharex="col")
    shown = (
        ("classic", "o", LINES[0], "best classic, best-stopped"),
        ("informed", "|", MUTED, "told the true weights, best-stopped"),
        ("wernet", "*", _DEFAULT, "WERNet"),
    )
    for axes, (flame, noise) in zip(panels.ravel(), scenes, strict=False):
        mine = [row for row in rows if (row["flame"], row["noise"]) == (flame, noise)]
        for key, marker, colour, label in shown:
            found = {row["effect"]: row[f"{key}_cosine_distance"] for row in mine}
            known = [effect for effect in effects if found.get(effect) is not None]
            if known:
                axes.plot(
                    [found[effect] for effect in known], [effects.index(e) for e in known],
                    marker, color=colour, markersize=9, label=label,
                )  # fmt: skip
        log_log(axes, room=0.15, names="x")
        axes.set_title(f"{flame}, 33 views, {noise}", fontsize=8.5, color=INK)
    for axes in panels.ravel():
        axes.set_yticks(range(len(effects)), effects, fontsize=7.5)
        axes.set_ylim(len(effects) - 0.4, -0.6)
    for axes in panels[-1]:
        axes.set_xlabel("cosine distance from the truth", fontsize=8)
    shared_legend(figure, panels)
    return figure


_DRAWN: Mapping[str, Callable[[Sequence[Row]], Figure]] = {
    "projectors": _projectors,
    "consistent": _consistent,
    "skipping": _skipping,
    "scaling_edge": _growth("edge", "voxels along the grid's edge"),
    "scaling_views": _growth("views", "views"),
    "threads": _threads,
    "mismatch_mean": _mismatch,
}
