"""The picture of learned weights: their means by depth, upstream light and angle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tomo.draw.figures import INK, MUTED, new_figure, thin_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tomo.pipeline.learned_weights import LearnedWeights, Profile

_LEARNED, _LIGHT = "#1f6fb2", "#e6eaee"


def draw_learned(learned: LearnedWeights, length_unit: str) -> Figure:
    """Return a figure of the mean relative weights, and of left-out pixels' residuals.

    Parameters
    ----------
    learned : LearnedWeights
    length_unit : str
        The grid's unit.
    """
    figure = new_figure(10.4, 3.0)
    *panels, last = figure.subplots(1, len(learned.profiles) + 1)
    units = {"length": length_unit, "root mean square pixel": "typical pixels"}
    for axes, profile in zip(panels, learned.profiles, strict=True):
        _draw_profile(axes, profile)
        axes.set_xlabel(f"{profile.quantity} ({units.get(profile.unit, profile.unit)})")
    panels[0].set_ylabel("weight / segment length", fontsize=8)
    _set_common_scale(panels, learned)
    _draw_residuals(last, learned)
    for axes in (*panels, last):
        thin_lines(axes)
        axes.xaxis.label.set_size(8)
    last.grid(False)
    words = f"learned weights: spread {learned.spread:.1%}"
    figure.text(0.012, 0.97, words, fontsize=8.5, color=INK, va="top")
    figure.tight_layout(rect=(0, 0, 1, 0.92))
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


def _set_common_scale(panels: list[Axes], learned: LearnedWeights) -> None:
    """Give the panels one scale, so that small differences look small."""
    weights = np.concatenate([profile.weight for profile in learned.profiles])
    low, high = min(np.nanmin(weights), 0.95), max(np.nanmax(weights), 1.05)
    room = 0.06 * (high - low)
    for axes in panels:
        axes.set_ylim(low - room, high + room)
        axes.axhline(1.0, color=MUTED, linewidth=0.7)


def _draw_residuals(axes: Axes, learned: LearnedWeights) -> None:
    known = {k: v for k, v in learned.held_out_residual.items() if math.isfinite(v)}
    names = [name for name in ("segment_lengths", "learned") if name in known]
    for row, name in enumerate(reversed(names)):
        axes.barh(row, known[name], 0.5, color=_LEARNED if name == "learned" else "#b9c0c7")
        axes.text(known[name], row, f" {known[name]:.2%}", va="center", fontsize=8, color=INK)
    words = {"segment_lengths": "segment\nlengths", "learned": "learned\nweights"}
    axes.set_yticks(range(len(names)), [words[name] for name in reversed(names)], fontsize=8)
    axes.set_xlabel("relative residual of left-out pixels", fontsize=8)
    axes.set_xlim(0, 1.25 * max(known.values(), default=1.0))
    axes.set_ylim(-0.9, len(names) - 0.1)
    axes.xaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
