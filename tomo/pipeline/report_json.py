"""report.json: a reconstruction as plain numbers, strings, lists and mappings."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Mapping
from typing import Any

import numpy as np

from tomo.pipeline.answer import verdict_of

_REPORTED_PACKAGES = ("flametomo", "numpy", "scipy", "numba", "torch", "open3d", "open3d-cpu")


def report_of(outcome: Any) -> dict[str, Any]:
    """Return the contents of ``report.json``: plain numbers, strings, lists and mappings.

    ``outcome`` is a `tomo.Reconstruction`, whose method ``report`` calls this.
    """
    found = outcome.solution
    report = {
        "answer": outcome.answer.report(),
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
        "alignment": outcome.alignment,
        "refinement": outcome.refinement,
        "explanation": outcome.explanation,
        "gains": outcome.gains,
        "learning": outcome.learning,
        "learned": outcome.learned.report() if outcome.learned else None,
        "uncertainty": outcome.uncertainty.report() if outcome.uncertainty else None,
        "relative_residual": found.relative_residual,
        "stop_reason": found.stop_reason,
        "quality": dict(found.quality),
        "held_out": {
            view.name: view.similarity(outcome.data_range)
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
                "stop_reason": other.stop_reason,
                "quality": dict(other.quality),
                "solver": dict(other.settings),
            }
            for other in outcome.comparisons
        ],
        "warnings": list(outcome.warnings),
        "versions": versions(),
        "seed": outcome.options.seed,
        "settings": outcome.options.to_mapping(),
        "solver": dict(found.settings),
    }
    return plain(report)


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
