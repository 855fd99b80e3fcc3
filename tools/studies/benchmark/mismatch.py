"""Chords against learned weights, on images that hold what chord lengths lack.

One effect at a time or all: gains that differ by 10 %, gas that absorbs (an optical depth of 2
across the box, or of 1 through the flame for its own light), 40 % of the light lost in the
corners, a blur of two voxels; pixels have an area everywhere. 33 views; no solver knows the
effects. "Classic" is the best of `studies.benchmark.classic`, stopped where
it is nearest to the truth; "informed" is the best of the least squares and of that one, so
stopped, with the true weights: about what the images allow. "wernet" is
`reconstruct(method="wernet")`, which stops by itself. Means over the seeds; seconds since the
images were in memory.
"""

from __future__ import annotations

import collections
import itertools
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from studies.benchmark.classic import CLASSIC, INFORMED, convergence_of, in_linear_basis
from studies.benchmark.mismatch_scenes import EFFECTS, NOISES, mismatch_scene
from studies.benchmark.sizes import SIZES
from studies.common.flames import FlameSize
from studies.common.scans import seconds_of
from studies.common.study import Request, Tables
from tomo import metrics
from tomo.operators import LINEAR, VOXEL

SEEDS = 1

COLUMNS = {
    "mismatch": "effect flame noise seeds classic classic_pass classic_cosine_distance "
    "classic_nrmse classic_seconds informed_cosine_distance wernet_cosine_distance wernet_nrmse "
    "wernet_seconds informed_of_classic wernet_of_classic",
}


def run(request: Request) -> Tables:
    """Return a row an effect, flame and noise: means over the seeds."""
    sizes = SIZES[request.size]
    effects = sizes.effects or tuple(EFFECTS)
    order = list(itertools.product(effects, sizes.flames, NOISES, sizes.seeds[:SEEDS]))
    rows = []
    for number, scene in enumerate(order):
        request.progress(number, len(order), "{}, {}, {}, seed {}".format(*scene))
        rows.append(mismatch_row(*scene, sizes.flame, sizes.passes))
    return {"mismatch": means(rows)}


def mismatch_row(
    effect: str, flame: str, noise: str, seed: int, size: FlameSize, passes: int
) -> dict[str, Any]:
    """Return what all methods make of one scene, see `mismatch_scene`."""
    scene = mismatch_scene(effect, flame, noise, seed, size)
    ready = scene.problem(midpoints=True)
    problems = {VOXEL: ready, LINEAR: in_linear_basis(ready)}
    classic = convergence_of(problems, scene.truth, CLASSIC, passes)
    best = min(classic, key=lambda name: classic[name].least)
    went = classic[best]
    alike = [one for one in CLASSIC if one in INFORMED or one.name == best]
    knowing = {
        basis: replace(one, system=replace(one.system, projector=projector))
        for basis, one in problems.items()
        if (projector := scene.informed(one.system)) is not None
    }
    informed = convergence_of(knowing, scene.truth, alike, passes)
    limit = min(informed.values(), key=lambda one: one.least)
    learned = scene.learned()
    return {
        "effect": effect,
        "flame": flame,
        "noise": noise,
        "seed": seed,
        "classic": best,
        "classic_pass": went.best,
        "classic_cosine_distance": went.least,
        "classic_nrmse": went.nrmses[went.best],
        "classic_seconds": went.seconds[went.best],
        "tried": {name: one.least for name, one in classic.items()},
        "informed_cosine_distance": limit.least,
        "wernet_cosine_distance": metrics.cosine_distance(learned.volume, scene.truth),
        "wernet_nrmse": metrics.nrmse(learned.volume, scene.truth),
        "wernet_seconds": seconds_of(learned),
    }


def means(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return means over the seeds, and ratios of means to the best classic method's."""
    groups: dict[tuple, list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["effect"], row["flame"], row["noise"]), []).append(row)
    found = []
    for (effect, flame, noise), group in groups.items():
        won = collections.Counter(row["classic"] for row in group)
        mean: dict[str, Any] = {
            "effect": effect,
            "flame": flame,
            "noise": noise,
            "seeds": len(group),
            "classic": " / ".join(name for name, _ in won.most_common()),
        }
        for key in group[0]:
            if key.startswith(("classic_", "informed_", "wernet_")):
                mean[key] = statistics.fmean(row[key] for row in group)
        classic = mean["classic_cosine_distance"]
        for name in ("informed", "wernet"):
            mean[f"{name}_of_classic"] = mean[f"{name}_cosine_distance"] / classic
        found.append(mean)
    return found
