"""What is measured on scenes: accuracy, ablations, and intervals."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import replace

from studies.common.study import Progress, Tables
from studies.scenes.design import FAULTY, QUICK_VIEWS, faultless, rank, special
from studies.scenes.exposure import TWELVE_BIT
from studies.scenes.recipe import SEEDS, Recipe
from studies.scenes.trial import Row, Trials

FAIR = (0.85, 0.98)  # fractions of voxels inside between which intervals of 90 % are fair
QUICK = 20  # scenes of a quick run, four of them with detail that is finer than views resolve
FINE = ("smoke sheets", "half-voxel sheets", "fine wrinkles", "fine ripples")

MEANS = ("coverage", "by_noise", "width", "rank", "rank_by_noise", "total", "planes", "edges")


def accuracy(trials: Trials, half: str, *, quick: bool, progress: Progress) -> Tables:
    """Measure the default's error over the best of a list of methods stopped by the truth.

    Faultless scenes of families, rigs and noises. The list is frozen: it has every classic method,
    both bases and strengths in steps of three; NRMSE, and the cosine distance of the same volumes.
    """
    rows = trials.run(faultless(half, quick=quick), progress, oracle=True)
    tables = {"overall": [_ratios(rows)]}
    for key in ("family", "views", "noise"):
        values = sorted({row[key] for row in rows})
        tables[f"by_{key}"] = [
            {key: value} | _ratios([row for row in rows if row[key] == value]) for value in values
        ]
    return tables | {"scenes": sorted(rows, key=lambda row: -row["of_best"])}


def _ratios(rows: Sequence[Row]) -> Row:
    ratios = [row["of_best"] for row in rows]
    return {
        "scenes": len(rows),
        "of_best": statistics.geometric_mean(ratios),
        "worst": max(ratios),
        "cosine_of_best": statistics.geometric_mean(row["cosine_of_best"] for row in rows),
        "seconds": statistics.fmean(row["seconds"] for row in rows),
    }


def ablation(trials: Trials, half: str, *, quick: bool, progress: Progress) -> Tables:
    """Compare the default that has a constant or an option set otherwise with the default.

    Ratios of NRMSE on faultless scenes: above one, what was changed was worth having.
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


def intervals(trials: Trials, half: str, *, quick: bool, progress: Progress) -> Tables:
    """Hold 90 % intervals against the truth: how many voxels, totals, planes and edges are inside.

    Faultless scenes, the special ones among them, and scenes with one camera out. Emitting voxels
    are those whose true value is above 2 % of the largest; ``width`` is the median half-width over
    the median error, ``rank`` the rank correlation of half-width and error. ``fair`` is the
    fraction of scenes with 85 to 98 % of the voxels inside.
    """
    recipes = sample(half) if quick else [*faultless(half), *special(half), *camera_out(half)]
    rows = [row | row["intervals"] for row in trials.run(recipes, progress) if row["intervals"]]
    kinds: dict[str, list[Row]] = {}
    for row in rows:
        few = "at most 8 views" if row["views"] <= 8 else "more views"
        for kind in (row["family"], few, row["fault"] or "faultless"):
            kinds.setdefault(kind, []).append(row)
    return {
        "overall": [_summary(rows)],
        "by_kind": [{"kind": kind} | _summary(own) for kind, own in sorted(kinds.items())],
        "scenes": sorted(rows, key=lambda row: row["coverage"]),
    }


def sample(half: str) -> list[Recipe]:
    """Return `QUICK` scenes: of each family, all special ones, a camera out; the rest by hash."""
    found = [*faultless(half, quick=True), *special(half), *camera_out(half, quick=True)]
    others = [one for one in faultless(half) if one not in found and one.family not in FINE]
    others.sort(key=lambda one: (one.views > QUICK_VIEWS, rank(one.name)))
    return found + others[: QUICK - len(found)]


def camera_out(half: str, *, quick: bool = False) -> list[Recipe]:
    """Return scenes of which one camera's image lies beside where it should."""
    families, rigs = FAULTY[half]
    pairs = [(number, number % len(rigs)) for number in range(len(families))]
    return [
        Recipe(
            half, families[family], rigs[rig], TWELVE_BIT, SEEDS[half] + 10 * family + rig,
            "shift", size,
        )
        for family, rig in pairs
        for size in ((1,) if quick else (0, 1))
    ]  # fmt: skip


def _summary(rows: Sequence[Row]) -> Row:
    covered = [row["coverage"] for row in rows]
    times = [row["seconds_times"] for row in rows if row["seconds_times"] is not None]
    return {
        "scenes": len(rows),
        "fair": statistics.fmean(FAIR[0] <= one <= FAIR[1] for one in covered),
        "least": min(covered),
        "most": max(covered),
        "seconds_times": statistics.median(times) if times else None,
    } | {name: statistics.fmean(row[name] for row in rows) for name in MEANS}
