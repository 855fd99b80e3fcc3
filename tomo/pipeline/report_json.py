"""report.json: a reconstruction as plain numbers, strings, lists and mappings."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tomo.pipeline.answer import verdict_of
from tomo.pipeline.verdict import judge
from tomo.radiometry.units import unit_of_total

_REPORTED_PACKAGES = ("flametomo", "numpy", "scipy", "numba", "torch", "open3d", "open3d-cpu")


def report_of(outcome: Any) -> dict[str, Any]:
    """Return ``report.json`` of a `tomo.Reconstruction`: plain numbers, words, lists, mappings."""
    found = outcome.solution
    compared: Sequence[Mapping[str, Any]] = outcome.compared or ({},) * len(outcome.comparisons)
    report = {
        "answer": outcome.answer.report(),
        **({} if outcome.preview is None else {"preview": outcome.preview}),
        "method": found.settings["method"],
        "seconds": dict(outcome.seconds),
        "first_use_seconds": outcome.first_use_seconds,
        "peak_memory_mb": found.peak_memory / 1e6,
        **outcome.counts,
        "scan": dict(outcome.scan),
        "projector": dict(outcome.projector),
        "basis": dict(outcome.basis),
        "pixel_weights": dict(outcome.pixel_weights),
        "carving": dict(outcome.carving),
        "screening": outcome.screening,
        "findings": [one.report() for one in outcome.findings],
        "detection_limits": outcome.detection_limits,
        "depth_of_field": outcome.depth_of_field,
        "refinement": outcome.refinement,
        "gains": outcome.gains,
        "learned": outcome.learned.report() if outcome.learned else None,
        "uncertainty": _uncertainty(outcome),
        "emission": _emission(outcome),
        "peak": asdict(outcome.peak),
        "relative_residual": found.relative_residual,
        "stop_reason": found.stop_reason,
        "quality": dict(found.quality),
        "held_out": {
            view.name: view.held_out_figures(outcome.peak.value)
            for view in outcome.views
            if view.held_out
        },
        "views": {
            view.name: {
                "verdict": verdict_of(view),
                "relative_residual": view.relative_residual,
                "noise": view.relative_noise,
                "residual_over_noise": view.residual_over_noise,
                "beyond_noise": view.beyond_noise,
                "gain": view.gain,
                "psnr": view.psnr(outcome.peak.value),
                "status": outcome.rig[view.name].status,
                "held_out": view.held_out,
                "excluded": view.excluded,
            }
            for view in outcome.views
        },
        "comparisons": [
            {
                "method": other.settings["method"],
                "seconds": dict(other.seconds),
                "relative_residual": other.relative_residual,
                "held_out": dict(held_out),
                "stop_reason": other.stop_reason,
                "quality": dict(other.quality),
                "solver": dict(other.settings),
            }
            for other, held_out in zip(outcome.comparisons, compared, strict=True)
        ],
        "warnings": list(outcome.warnings),
        "versions": versions(),
        "seed": outcome.options.seed,
        "settings": outcome.options.to_mapping(),
        "solver": dict(found.settings),
    }
    figures = plain(report)
    return {"answer": figures["answer"], "verdict": judge(figures).report(), **figures}


def _emission(outcome: Any) -> dict[str, Any]:
    """Return the volume's total and largest value with their units.

    An absolute total is a power into a steradian; ``power`` is 4 pi times as much, into all
    directions.
    """
    found = outcome.solution
    unit, factor = _of_total(outcome)
    whole = factor * found.volume.total()
    report = {
        "largest": float(found.volume.max(initial=0.0)),
        "unit": outcome.value_unit,
        "total": whole,
        "total_unit": unit,
    }
    if "/sr" in unit:
        report |= {"power": 4 * math.pi * whole, "power_unit": unit.replace("/sr", "")}
    return report


def _uncertainty(outcome: Any) -> dict[str, Any] | None:
    """Return ``uncertainty``, its total in the unit of that of ``emission``."""
    if outcome.uncertainty is None:
        return None
    report = outcome.uncertainty.report()
    intervals = report.get("intervals")
    if intervals:
        unit, factor = _of_total(outcome)
        own = {name: factor * value for name, value in intervals["total"].items()}
        report["intervals"] = intervals | {"total": own | {"unit": unit}}
    return report


def _of_total(outcome: Any) -> tuple[str, float]:
    return unit_of_total(outcome.value_unit, outcome.rig.length_unit)


def versions() -> dict[str, str]:
    """Return the versions of Python and of what computed the result."""
    found = {"python": platform.python_version()}
    for package in _REPORTED_PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def plain(value: object) -> Any:
    """Return JSON's own types; NaN and infinity, which JSON lacks, become None."""
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value if value is None else str(value)
