"""The default with a constant or an option set otherwise, over the default as it is.

Ratios of NRMSE on the faultless scenes of a half: above one, what was changed was worth having.
"""

from __future__ import annotations

import statistics
from dataclasses import replace

from studies.common.study import Progress, Tables
from studies.scenes.design import faultless
from studies.scenes.trial import Trials

COLUMNS = {
    "overall": "changed scenes times best worst seconds_times",
    "scenes": "scene nrmse times seconds",
}


def ablation(trials: Trials, half: str, *, quick: bool, progress: Progress) -> Tables:
    """Return how the errors change: over all scenes, and of each.

    Raises
    ------
    ValueError
        If nothing is changed.
    """
    changes = {**trials.options, **trials.constants}
    if not changes:
        raise ValueError("--part ablation: found nothing changed, expected --set or --option")
    recipes = faultless(half, quick=quick)
    usual = replace(trials, options={}, constants={}, resume=True)
    before, after = usual.run(recipes, progress), trials.run(recipes, progress)
    rows = [
        new | {"times": new["nrmse"] / old["nrmse"], "before": old["nrmse"]}
        for old, new in zip(before, after, strict=True)
    ]
    times = [row["times"] for row in rows]
    overall = {
        "changed": ", ".join(f"{name}={value}" for name, value in changes.items()),
        "scenes": len(rows),
        "times": statistics.geometric_mean(times),
        "best": min(times),
        "worst": max(times),
        "seconds_times": sum(r["seconds"] for r in after) / sum(r["seconds"] for r in before),
    }
    return {"overall": [overall], "scenes": sorted(rows, key=lambda row: row["times"])}
