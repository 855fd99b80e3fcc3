"""Rows as figures: convergence curves, first losses, and cross-sections beside the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from _paper.cases import FINER, grid_of, truth_of
from _paper.claims import short
from _paper.sizes import Problem, Sizes
from _paper.training import PER_MILLE, section
from tomo.draw.figures import INK, MUTED, new_figure, thin_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = Mapping[str, Any]
_LINES = ("#1f6fb2", "#c2500f", "#12826a", "#7d5ba6", "#9a7b00", "#a3466a", "#5b6672", "#1b2733")
_GOAL = 1e-3
_MOST_INSIDE = 6  # curves whose legend fits between them
_MOST_ABREAST = 5


def plots(
    studies: Mapping[str, Sequence[Row]], sizes: Sizes
) -> dict[str, dict[str, Callable[[], Figure]]]:
    """Return, for each study, what draws its figures, by name."""
    found: dict[str, dict[str, Callable[[], Figure]]] = {}
    for name, words in _CURVES.items():
        if studies.get(name):
            shown = [(words(row), row) for row in studies[name]]
            levels = _on_all_rays(studies) if name == "denoising" else ()
            found[name] = {f"{name}_convergence": partial(_convergence, shown, levels)}
    for name, rows in _SECTIONS.items():
        chosen = rows(studies)
        if chosen:
            problem = sizes.large if name in ("layouts", "denoising") else sizes.problem
            for suffix, some in _pages(chosen).items():
                draw = partial(_sections, some, problem)
                found.setdefault(name, {})[f"{name}_sections{suffix}"] = draw
    if studies.get("first_steps"):
        found["first_steps"] = {"first_steps": partial(_first_steps, studies["first_steps"])}
    return found


def _pages(shown: list[tuple[str, Row]]) -> dict[str, list[tuple[str, Row]]]:
    """Return the cases for one figure each: one flame's where there are many."""
    if len(shown) <= _MOST_ABREAST:
        return {"": shown}
    flames = dict.fromkeys(row["flame"] for _, row in shown)
    return {
        f"_{flame}": [(w, row) for w, row in shown if row["flame"] == flame] for flame in flames
    }


def _convergence(shown: Sequence[tuple[str, Row]], levels: Sequence[Row]) -> Figure:
    """Return cosine distance against epoch, a panel for each flame; levels are ART's."""
    flames = list(dict.fromkeys(row["flame"] for _, row in shown))
    figure = new_figure(5.2 * len(flames) + 0.4 if len(flames) > 1 else 6.8, 4.0)
    panels = figure.subplots(1, len(flames), squeeze=False, sharey=True)[0]
    for axes, flame in zip(panels, flames, strict=True):
        mine = [(words, row) for words, row in shown if row["flame"] == flame]
        for (words, row), (colour, style) in zip(mine, _looks(len(mine)), strict=True):
            epochs, distances = zip(*((e, d) for e, d, _ in row["course"]), strict=True)
            axes.plot(epochs, distances, style, color=colour, linewidth=1.4, label=words)
            axes.plot(epochs[-1], distances[-1], "o", color=colour, markersize=4)
        best = [row for row in levels if row["flame"] == flame]
        for row, style in zip(best, ("--", "-.", ":", (0, (1, 3))), strict=False):
            axes.axhline(
                row["cosine_distance"], color=MUTED, linestyle=style, linewidth=1.0,
                label=_by_art(row),
            )  # fmt: skip
        if not mine[0][1]["noise"]:
            axes.axhline(_GOAL, color=MUTED, linewidth=0.6, zorder=0)
        axes.set_title(f"{flame}", fontsize=8.5, color=INK)
        axes.set_xlabel("epoch", fontsize=8)
        _log(axes)
        if len(mine) + len(best) <= _MOST_INSIDE:
            axes.legend(fontsize=7.5, frameon=False)
        elif flame == flames[-1]:  # one for all panels, which show the same
            axes.legend(fontsize=7.5, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    panels[0].set_ylabel("cosine distance from the truth", fontsize=8)
    figure.tight_layout()
    return figure


def _first_steps(rows: Sequence[Row]) -> Figure:
    """Return the loss of each of the first steps: a panel for each variant."""
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    figure = new_figure(5.2 * len(variants), 3.6)
    panels = figure.subplots(1, len(variants), squeeze=False, sharey=True)[0]
    for axes, variant in zip(panels, variants, strict=True):
        for row in rows:
            if row["variant"] == variant:
                normalised = row["normalise_gradient"]
                axes.plot(
                    range(1, len(row["losses"]) + 1), row["losses"], linewidth=1.3,
                    color=_LINES[0 if normalised else 1],
                    linestyle="-" if normalised else "--",
                    label=f"{'with' if normalised else 'without'} gradient normalisation",
                )  # fmt: skip
        axes.set_title(f"jet, {variant}", fontsize=8.5, color=INK)
        axes.set_xlabel("step of the first epoch", fontsize=8)
        _log(axes)
        axes.legend(fontsize=7.5, frameon=False)
    panels[0].set_ylabel("loss of the batch", fontsize=8)
    figure.tight_layout()
    return figure


def _sections(shown: Sequence[tuple[str, Row]], problem: Problem) -> Figure:
    """Return truth, reconstruction and difference in the plane z = 0, case by case."""
    grid = grid_of(problem)
    tall = 3.3
    wide = tall * grid.extent[0] / grid.extent[1]
    gap, block_gap, left, bar = 0.06, 0.30, 0.42, 0.95
    block = 3 * wide + 2 * gap
    width = left + len(shown) * (block + block_gap) + bar
    height = tall + 1.25
    figure = new_figure(width, height)
    lower, upper = grid.lower, grid.upper
    extent = (lower[0], upper[0], lower[1], upper[1])
    pictures = []
    for words, row in shown:
        truth = truth_of(row["flame"], problem)
        true = np.array(section(truth, truth, problem)) / PER_MILLE
        found = np.array(row["section"]) / PER_MILLE
        pictures.append((words, row, (true, found, found - true)))
    spread = max(float(np.quantile(np.abs(p[2]), 0.999)) for _, _, p in pictures)
    limit = max(spread, 2 / PER_MILLE)
    drawn: list = []
    for number, (words, row, parts) in enumerate(pictures):
        x0 = left + number * (block + block_gap)
        ends = ((0.0, 1.0, "inferno"), (0.0, 1.0, "inferno"), (-limit, limit, "RdBu_r"))
        for k, (part, (low, high, colours)) in enumerate(zip(parts, ends, strict=True)):
            rect = (x0 + k * (wide + gap), 0.48, wide, tall)
            axes = figure.add_axes(
                (rect[0] / width, rect[1] / height, rect[2] / width, rect[3] / height)
            )
            drawn.append(
                axes.imshow(
                    part, origin="lower", extent=extent, vmin=low, vmax=high, cmap=colours,
                    interpolation="nearest", aspect="auto",
                )
            )  # fmt: skip
            axes.set_title(("truth", "found", "difference")[k], fontsize=6.5, color=MUTED, pad=3)
            axes.tick_params(labelsize=6, colors=MUTED, length=2, pad=2)
            axes.set_xticks([-5, 5] if grid.extent[0] > 10 else [0])
            if number or k:
                axes.set_yticklabels([])
            if not number and not k:
                axes.set_ylabel("y (mm)", fontsize=7, color=INK, labelpad=1)
            if k == 1:
                axes.set_xlabel("x (mm)", fontsize=7, color=INK, labelpad=2)
            for spine in axes.spines.values():
                spine.set(color="#9aa5b1", linewidth=0.5)
        lines = f"{words}\ncosine distance {row['cosine_distance']:.2g}"
        figure.text((x0 + block / 2) / width, (0.48 + tall + 0.24) / height, lines, fontsize=7,
                    color=INK, ha="center", va="bottom", linespacing=1.4)  # fmt: skip
    for image, offset, span, label in (
        (drawn[0], 0.54, 0.44, "emission over its maximum"),
        (drawn[2], 0.0, 0.44, "difference"),
    ):
        rect = (width - bar + 0.06, 0.48 + offset * tall, 0.09, span * tall)
        axes = figure.add_axes(
            (rect[0] / width, rect[1] / height, rect[2] / width, rect[3] / height)
        )
        figure.colorbar(image, cax=axes)
        axes.tick_params(labelsize=6, colors=MUTED, length=2, pad=2)
        axes.set_ylabel(label, fontsize=6.5, color=INK)
    return figure


def _log(axes: Axes) -> None:
    """Give a plot a logarithmic axis upward, whose ends are on round numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    low, high = axes.get_ylim()
    narrow = high / low < 300
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1,)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    thin_lines(axes)


def _looks(count: int) -> list[tuple[str, str]]:
    """Return a colour and a line style for each curve."""
    styles = ("-", "--", ":")
    return [
        (_LINES[n % len(_LINES)], styles[n // len(_LINES) % len(styles)]) for n in range(count)
    ]


def _images(row: Row) -> str:
    return ", finer images" * row["layout"].endswith(FINER)


def _by_art(row: Row) -> str:
    return f"ART, {'stopped best' if row['stopped'] == 'best' else 'not relaxed'}{_images(row)}"


def _on_all_rays(studies: Mapping[str, Sequence[Row]]) -> list[Row]:
    return [row for row in studies.get("art") or () if row["on"] == "all rays and voxels"]


def _way(row: Row) -> str:
    return f"encoder of {row['encoder_of']}, {'frozen' if row['frozen'] else 'trained on'}"


_CURVES: Mapping[str, Callable[[Row], str]] = {
    "readings": lambda row: row["reading"],
    "noisy_readings": lambda row: row["reading"],
    "layouts": lambda row: short(row["layout"]),
    "views": lambda row: short(row["layout"]),
    "ablation": lambda row: row["variant"],
    "normalisation": lambda row: (
        f"{'with' if row['normalise_gradient'] else 'without'} gradient normalisation"
    ),
    "denoising": lambda row: f"WERNet, {100 * row['samples_per_batch']} rays a step{_images(row)}",
    "transfer": _way,
}


def _labelled(study: str) -> Callable[[Mapping[str, Sequence[Row]]], list[tuple[str, Row]]]:
    return lambda studies: [(_CURVES[study](row), row) for row in studies.get(study) or ()]


def _with_art(studies: Mapping[str, Sequence[Row]]) -> list[tuple[str, Row]]:
    """Return WERNet's results, and then ART's on the finer images."""
    shown = [(_CURVES["denoising"](row), row) for row in studies.get("denoising") or ()]
    finer = [row for row in _on_all_rays(studies) if row["layout"].endswith(FINER)]
    return shown + [(_by_art(row), row) for row in finer]


def _frozen(studies: Mapping[str, Sequence[Row]]) -> list[tuple[str, Row]]:
    rows = [row for row in studies.get("transfer") or () if row["frozen"]]
    return [(f"{row['encoder_of']} to {row['flame']}, frozen", row) for row in rows]


_SECTIONS: Mapping[str, Callable[[Mapping[str, Sequence[Row]]], list[tuple[str, Row]]]] = {
    "layouts": _labelled("layouts"),
    "views": _labelled("views"),
    "ablation": _labelled("ablation"),
    "denoising": _with_art,
    "transfer": _frozen,
}
