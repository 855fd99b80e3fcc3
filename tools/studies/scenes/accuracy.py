"""The default's error over the best of a frozen list of methods that are stopped by the truth.

Faultless scenes of families, rigs and noises. The list has every classic method, both bases and
strengths in steps of three; NRMSE, and the cosine distance of the same volumes.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from studies.common.study import Progress, Tables
from studies.scenes.design import faultless
from studies.scenes.trial import Row, Trials

COLUMNS = {
    "overall": "scenes of_best worst cosine_of_best seconds",
    "by_family": "family scenes of_best worst cosine_of_best seconds",
    "by_views": "views scenes of_best worst cosine_of_best seconds",
    "by_noise": "noise scenes of_best worst cosine_of_best seconds",
    "scenes": "scene nrmse of_best cosine_of_best method basis best best_nrmse seconds",
}


def accuracy(trials: Trials, half: str, *, quick: bool, progress: Progress) -> Tables:
    """Return ratios of errors: over all scenes, by family, views and noise, and of each scene."""
    rows = trials.run(faultless(half, quick=quick), progress, oracle=True)
    tables = {"overall": [_summary(rows)]}
    for key in ("family", "views", "noise"):
        values = sorted({row[key] for row in rows})
        tables[f"by_{key}"] = [
            {key: value} | _summary([row for row in rows if row[key] == value]) for value in values
        ]
    return tables | {"scenes": sorted(rows, key=lambda row: -row["of_best"])}


def _summary(rows: Sequence[Row]) -> Row:
    ratios = [row["of_best"] for row in rows]
    return {
        "scenes": len(rows),
        "of_best": statistics.geometric_mean(ratios),
        "worst": max(ratios),
        "cosine_of_best": statistics.geometric_mean(row["cosine_of_best"] for row in rows),
        "seconds": statistics.fmean(row["seconds"] for row in rows),
    }
