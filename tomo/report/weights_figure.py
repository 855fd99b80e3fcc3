"""The picture of learned weights: their means by depth, camera, position and upstream light."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tomo.draw.figures import INK, MUTED, new_figure, plain, thin_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tomo.wernet.default import LearnedWeights, Profile

_LEARNED, _AXES = "#1f6fb2", {"x": "#1f6fb2", "y": "#12826a", "z": "#c2500f"}
_LIGHT = "#e6eaee"


def draw_learned(learned: LearnedWeights, length_unit: str) -> Figure:
    """Return a figure of the mean relative weights, the true ones dashed where they are known.

    Parameters
    ----------
    learned : LearnedWeights
    length_unit : str
        The grid's unit.
    """
    figure = new_figure(10.4, 5.6)
    panels = figure.subplots(2, 3).ravel()
    voxel = [p for p in learned.profiles if p.quantity.startswith("position in the voxel")]
    others = [p for p in learned.profiles if p not in voxel]
    for axes, profile in zip(panels, others, strict=False):
        _draw_light(axes, profile)
        _draw_line(axes, profile, _LEARNED)
        unit = {"length": length_unit, "root mean square pixel": "typical pixels"}
        unit["largest"] = "largest is 1"
        lit = np.flatnonzero(np.isfinite(profile.weight))
        if len(lit):
            axes.set_xlim(profile.edges[lit[0]], profile.edges[lit[-1] + 1])
        axes.set_xlabel(f"{profile.quantity} ({unit.get(profile.unit, profile.unit)})")
    for profile in voxel:
        axis = profile.quantity[-1]
        _draw_line(panels[3], profile, _AXES[axis], axis)
    panels[3].set_xlabel("position in the voxel (voxels from its middle)")
    panels[3].legend(fontsize=7, frameon=False, ncols=3, loc="upper center")
    _draw_cameras(panels[4], learned)
    _set_common_scale(panels[:5], learned)
    for axes in panels:
        thin_lines(axes)
        axes.xaxis.label.set_size(8)
    for axes in (panels[0], panels[3]):
        axes.set_ylabel("weight / segment length", fontsize=8)
    _draw_residuals(panels[5], learned)
    panels[5].grid(False)
    known = learned.true_by_camera is not None
    words = f"learned: mean {learned.mean:.3f}, spread {learned.spread:.1%}"
    if known and learned.explained is not None:
        words += f"; dashed: the truth, {learned.explained:.0%} of it learned"
    figure.text(0.012, 0.985, words, fontsize=8.5, color=INK, va="top")
    figure.tight_layout(rect=(0, 0, 1, 0.955))
    return figure


def _draw_line(axes: Axes, profile: Profile, colour: str, label: str | None = None) -> None:
    axes.plot(
        profile.centre, profile.weight, marker="o", markersize=2.6, label=label, color=colour,
        linewidth=1.5,
    )  # fmt: skip
    if profile.truth is not None:
        axes.plot(profile.centre, profile.truth, linestyle="--", color=colour, linewidth=1.1)


def _draw_light(axes: Axes, profile: Profile) -> None:
    """Draw the fraction of the light in each bin behind the means."""
    behind = axes.twinx()
    behind.bar(profile.centre, profile.light, np.diff(profile.edges), color=_LIGHT)
    behind.set_ylim(0, 3 * max(profile.light.max(), 1e-9))
    behind.set_axis_off()
    axes.set_zorder(behind.get_zorder() + 1)
    axes.patch.set_visible(False)


def _draw_cameras(axes: Axes, learned: LearnedWeights) -> None:
    number = np.arange(len(learned.cameras))
    axes.plot(number, learned.by_camera, "o", color=_LEARNED, markersize=3.6)
    if learned.true_by_camera is not None:
        axes.plot(number, learned.true_by_camera, "--", color=_LEARNED, linewidth=1.1)
    names = [plain(name if len(name) <= 10 else f"{name[:9]}…") for name in learned.cameras]
    room = 6 if max(map(len, names), default=0) <= 5 else 5
    step = max(1, math.ceil(len(number) / room))
    axes.set_xticks(number[::step], names[::step])
    axes.set_xlabel("camera")


def _set_common_scale(panels: list[Axes], learned: LearnedWeights) -> None:
    """Give the panels one scale, so that small differences look small."""
    shown = [learned.by_camera, *(profile.weight for profile in learned.profiles)]
    if learned.true_by_camera is not None:
        shown += [learned.true_by_camera, *(profile.truth for profile in learned.profiles)]
    weights = np.concatenate(shown)
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
    axes.set_xlabel("relative residual of left-out views", fontsize=8)
    axes.set_xlim(0, 1.25 * max(known.values(), default=1.0))
    axes.set_ylim(-0.9, len(names) - 0.1)
    axes.xaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
