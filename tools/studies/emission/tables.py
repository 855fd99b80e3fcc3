"""The tables and curves of the rows that are done."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from studies.common.axes import curves
from studies.common.study import Tables
from studies.emission.methods import METHODS
from studies.emission.scenes import SCENES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]

BASELINE = "auto"
MARKS = ("*", "^", "s", "P", "X")
"""Signs of the methods that choose their own end, in the order of `METHODS`."""


def tables_of(rows: Sequence[Row]) -> Tables:
    """Return means by method, and the nearest of each scene."""
    by_scene: dict[str, dict[str, Row]] = {}
    for name in SCENES:
        own = {row["method"]: row for row in rows if row["scene"] == name}
        if own:
            by_scene[name] = own
    return {
        "methods": [
            _means(m, by_scene) for m in METHODS if any(m in o for o in by_scene.values())
        ],
        "nearest": [_nearest(name, own) for name, own in by_scene.items() if BASELINE in own],
    }


def _means(method: str, by_scene: Mapping[str, Mapping[str, Row]]) -> Row:
    """Return what a method came to over its scenes, and against the default on those."""
    own = [scene[method] for scene in by_scene.values() if method in scene]
    both = [s for s in by_scene.values() if method in s and BASELINE in s]
    ratios = [s[method]["nrmse"] / s[BASELINE]["nrmse"] for s in both]
    return {
        "method": method,
        "tuned_by_truth": not METHODS[method].is_ours,
        "scenes": len(own),
        "nrmse_of_auto": statistics.geometric_mean(ratios) if ratios else None,
        "nearer_than_auto": sum(ratio < 1 for ratio in ratios),
        "ssim": statistics.fmean(row["ssim"] for row in own),
        "held_out_psnr": statistics.fmean(row["held_out_psnr"] for row in own),
        "cpu_seconds": statistics.median(row["cpu_seconds"] for row in own),
        "tuning_seconds": statistics.median(row["tuning_seconds"] or 0.0 for row in own),
    }


def _nearest(name: str, own: Mapping[str, Row]) -> Row:
    """Return which method is nearest to a scene's truth, and how far the default is from it."""
    best = min(own.values(), key=lambda row: row["nrmse"])
    return {
        "scene": name,
        "family": SCENES[name].family,
        "rig": SCENES[name].rig,
        "nearest": best["method"],
        "its_nrmse": best["nrmse"],
        "auto_nrmse": own[BASELINE]["nrmse"],
        "auto_of_nearest": own[BASELINE]["nrmse"] / best["nrmse"],
        "its_seconds": best["cpu_seconds"],
        "auto_seconds": own[BASELINE]["cpu_seconds"],
    }


def figure_of(by_scene: Mapping[str, Mapping[str, list]]) -> Figure:
    """Draw a panel a scene: the least error that each method had by a run time."""
    panels = {
        name: {m: by_scene[name][m] for m in METHODS if m in by_scene[name]}
        for name in SCENES
        if name in by_scene
    }
    marks = dict(zip((m for m in METHODS if METHODS[m].is_ours), MARKS, strict=True))
    return curves(panels, "CPU seconds, one thread", "NRMSE", most_abreast=3, marks=marks)
