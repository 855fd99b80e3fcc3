"""No inverse crime: images have several rays a pixel through voxels finer than the grid's.

`auto` is the default, which chooses and stops without the truth; every other method has the
settings that were best on seed 0 and is stopped where it is nearest to the truth; `art` skips
nothing. Means over the other seeds; seconds since the images were in memory, tracing included,
for `auto` choosing too.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from studies.benchmark.convergence import Convergence, converged, means
from studies.benchmark.sizes import SIZES, Sizes
from studies.common.flames import NOISES, RIGS, Scene, scene
from studies.common.scans import Problem, problem, reconstructed, seconds_of
from studies.common.study import Request, Tables
from studies.scenes.scene import warm_up
from tomo import solvers

BASELINE, AUTO = "art", "auto"

TRIED: Mapping[str, Mapping[str, tuple]] = {
    "art": {"relaxation": (0.1, 0.03, 0.3, 1.0, 0.01)},
    "curvature": {"strength": (1e-3, 1e-2, 1e-1)},
    "mart": {"relaxation": (0.2, 0.05, 0.5)},
    "mlem": {"subsets": (1, 8)},
    "sart": {"relaxation": (0.3, 1.0, 0.1)},
    "sirt": {"relaxation": (1.0, 1.9), "subsets": (1, 8)},
    "tikhonov": {"strength": (1e-3, 1e-2, 1e-4, 1e-1)},
    "tv": {"strength": (0.005, 0.02, 0.001, 0.0002)},
}
"""Settings of which `SETTINGS` are tried on seed 0, the likeliest first."""

SETTINGS = 2


def run(request: Request) -> Tables:
    """Return a row a flame, number of views, noise and method: means over the seeds."""
    warm_up()
    sizes = SIZES[request.size]
    scenes = itertools.product(sizes.flames, (0, *sizes.seeds), RIGS, NOISES)
    settings: dict[tuple, dict[str, Mapping[str, Any]]] = {}
    runs: list[dict[str, Any]] = []
    said = "{0[0]}, {0[2]} views, {0[3]}, seed {0[1]}".format
    for flame, seed, views, noise in request.each(scenes, said):
        seen = scene(flame, views, noise, seed, sizes.flame)
        images = seen.scan.rig, seen.scan.grid, seen.images
        skipped, plain = (problem(*images, skip=skip) for skip in (True, False))
        ready = {m: plain if m == BASELINE else skipped for m in solvers.METHODS}
        kind = flame, views, noise
        if seed == 0:
            settings[kind] = {m: _tuned(m, ready[m], seen, sizes) for m in ready}
            continue
        for method in solvers.METHODS:
            chosen = settings[kind][method]
            went = converged(ready[method], seen.scan.truth, method, chosen, passes=sizes.passes)
            runs.append(_run(seen, ready[method], method, chosen, went))
        runs.append(_default(seen))
    return {"solvers": with_ratios(runs)}


def settings_of(method: str, most: int) -> list[dict[str, Any]]:
    """Return at most ``most`` settings of a method to try, the likeliest first."""
    known = inspect.signature(getattr(solvers, method)).parameters
    tried = {name: v for name, v in TRIED.get(method, {}).items() if name in known}
    every = (
        dict(zip(tried, values, strict=True)) for values in itertools.product(*tried.values())
    )
    return list(itertools.islice(every, most))


def with_ratios(runs: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return means over the seeds, and the ratio to best-stopped ART."""
    scene = "flame", "views", "noise"
    found = means(runs, *scene, "method")
    art = {
        tuple(row[key] for key in scene): row["cosine_distance"]
        for row in found
        if row["method"] == BASELINE
    }
    for row in found:
        row["of_best_art"] = row["cosine_distance"] / art[tuple(row[key] for key in scene)]
    return found


def _tuned(method: str, ready: Problem, seen: Scene, sizes: Sizes) -> dict[str, Any]:
    """Return the settings that come nearest to the truth of seed 0, best-stopped."""
    tried = settings_of(method, SETTINGS)
    if len(tried) == 1:
        return tried[0]
    truth, passes = seen.scan.truth, sizes.passes
    return min(tried, key=lambda one: converged(ready, truth, method, one, passes=passes).least)


def _run(
    seen: Scene, ready: Problem, method: str, settings: Mapping, went: Convergence
) -> dict[str, Any]:
    return seen.named | {
        "method": method,
        "settings": settings,
        "best_pass": went.best,
        "cosine_distance": went.least,
        "nrmse": went.nrmses[went.best],
        "seconds": went.seconds[went.best],
        "prepare_seconds": ready.seconds,
        "curves": list(zip(went.seconds, went.cosine_distances, strict=True))[1:],
    }


def _default(seen: Scene) -> dict[str, Any]:
    """Run the default, which chooses without the truth and stops by itself."""
    outcome = reconstructed(seen.scan, seed=seen.seed)
    found, total = outcome.solution, seconds_of(outcome)
    return seen.named | {
        "method": AUTO,
        "settings": {},
        "best_pass": len(found.history) - 1,
        "cosine_distance": found.quality["cosine_distance"],
        "nrmse": found.quality["nrmse"],
        "seconds": total,
        "prepare_seconds": total - (outcome.seconds["solve"] - outcome.seconds["choose"]),
        "curves": [(total, found.quality["cosine_distance"])],
    }


def _panels(tables: Tables, flame: str) -> tuple[dict[str, dict[str, Any]], str, str]:
    panels: dict[str, dict[str, Any]] = {}
    for row in tables["solvers"]:
        if row["flame"] == flame:
            title = f"{flame}, {row['views']} views, {row['noise']}"
            panels.setdefault(title, {})[row["method"]] = row["curves"]
    return panels, "seconds since the images were in memory", "cosine distance"


PLOTS = {f"solvers_{flame}": partial(_panels, flame=flame) for flame in ("jet", "turbulent")}
