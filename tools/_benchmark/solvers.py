"""Error against seconds of every solver and of the default, without inverse crime."""

from __future__ import annotations

import inspect
import itertools
import statistics
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from _benchmark.courses import Course, course
from _benchmark.problems import Problem, problem
from _benchmark.scenes import NOISES, RIGS, Scene, scene
from _benchmark.sizes import Sizes
from tomo import solvers as methods
from tomo.pipeline import reconstruct

Progress = Callable[[int, int, str], None]
Rows = dict[str, list[dict[str, Any]]]

BASELINE = "art"
"""Runs as it was published, on all pixels and voxels; the other methods skip."""

AUTO = "auto"

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
"""Settings tried on seed 0, the likeliest first."""


@dataclass(frozen=True)
class Run:
    """One method on one scene.

    Attributes
    ----------
    flame, views, noise, seed
        The scene.
    method : str
    settings : mapping
        Of the method; for ``auto`` what it chose.
    best_pass, passes : int
        Where it was best, and how far it went; for ``auto`` where it stopped by itself.
    cosine_distance, nrmse : float
        There.
    seconds : float
        Until then, since the images were in memory.
    prepare_seconds : float
        Of these, before the first pass; for ``auto`` also choosing.
    segments, active_voxels : int
    course : list of (seconds, cosine distance, NRMSE), or None
        After each pass; of the first seed only.
    """

    flame: str
    views: int
    noise: str
    seed: int
    method: str
    settings: Mapping[str, Any]
    best_pass: int
    passes: int
    cosine_distance: float
    nrmse: float
    seconds: float
    prepare_seconds: float
    segments: int
    active_voxels: int
    course: list | None = None


def solvers(sizes: Sizes, progress: Progress) -> Rows:
    """Return ``solvers``, one row a run, and ``solvers_mean``, over the seeds."""
    scenes = list(itertools.product(sizes.flames, (0, *sizes.seeds), RIGS, NOISES))
    settings: dict[tuple, dict[str, Mapping[str, Any]]] = {}
    runs: list[Run] = []
    for number, (flame, seed, views, noise) in enumerate(scenes):
        progress(number, len(scenes), f"{flame}, {views} views, {noise}, seed {seed}")
        seen = scene(flame, views, noise, seed, sizes)
        images = seen.scan.rig, seen.scan.grid, seen.images
        skipped, plain = (problem(*images, skip=skip) for skip in (True, False))
        ready = {m: plain if m == BASELINE else skipped for m in methods.METHODS}
        kind = flame, views, noise
        if seed == 0:
            settings[kind] = {m: _tuned(m, ready[m], seen, sizes) for m in ready}
            continue
        for method in methods.METHODS:
            chosen = settings[kind][method]
            went = course(ready[method], seen.scan.truth, method, chosen, passes=sizes.passes)
            runs.append(
                _run(seen, ready[method], method, chosen, went, keep=seed == sizes.seeds[0])
            )
        runs.append(_default(seen))
    progress(len(scenes), len(scenes), "")
    return {"solvers": [asdict(run) for run in runs], "solvers_mean": means(runs)}


def settings_of(method: str, most: int) -> list[dict[str, Any]]:
    """Return at most ``most`` settings of a method to try, the likeliest first."""
    known = inspect.signature(getattr(methods, method)).parameters
    tried = {name: v for name, v in TRIED.get(method, {}).items() if name in known}
    every = (
        dict(zip(tried, values, strict=True)) for values in itertools.product(*tried.values())
    )
    return list(itertools.islice(every, most))


def means(runs: list[Run]) -> list[dict[str, Any]]:
    """Return mean and standard deviation over the seeds, and the ratio to best-stopped ART."""
    groups: dict[tuple, list[Run]] = {}
    for run in runs:
        groups.setdefault((run.flame, run.views, run.noise, run.method), []).append(run)
    mean = {
        key: statistics.fmean(r.cosine_distance for r in group) for key, group in groups.items()
    }
    rows = []
    for (flame, views, noise, method), group in groups.items():
        distance = mean[flame, views, noise, method]
        rows.append(
            {
                "flame": flame,
                "views": views,
                "noise": noise,
                "method": method,
                "settings": dict(group[0].settings) if method != AUTO else {},
                "seeds": len(group),
                "cosine_distance": distance,
                "cosine_distance_spread": _spread(r.cosine_distance for r in group),
                "nrmse": statistics.fmean(r.nrmse for r in group),
                "nrmse_spread": _spread(r.nrmse for r in group),
                "best_pass": statistics.fmean(r.best_pass for r in group),
                "seconds": statistics.fmean(r.seconds for r in group),
                "of_best_art": distance / mean[flame, views, noise, BASELINE],
            }
        )
    return rows


def _spread(values: Iterator[float]) -> float:
    values = list(values)
    return statistics.stdev(values) if len(values) > 1 else 0.0


def _tuned(method: str, ready: Problem, seen: Scene, sizes: Sizes) -> dict[str, Any]:
    """Return the settings that come nearest to the truth of seed 0, best-stopped."""
    tried = settings_of(method, sizes.settings)
    if len(tried) == 1:
        return tried[0]

    def reached(settings: Mapping[str, Any]) -> float:
        went = course(ready, seen.scan.truth, method, settings, passes=sizes.passes)
        return min(went.cosine_distances)

    return min(tried, key=reached)


def _run(
    seen: Scene, ready: Problem, method: str, settings: Mapping, went: Course, *, keep: bool
) -> Run:
    columns = (went.seconds, went.cosine_distances, went.nrmses)
    return Run(
        seen.flame,
        seen.views,
        seen.noise,
        seen.seed,
        method,
        settings,
        best_pass=went.best,
        passes=len(went.seconds) - 1,
        cosine_distance=went.least,
        nrmse=went.nrmses[went.best],
        seconds=went.seconds[went.best],
        prepare_seconds=ready.seconds,
        segments=ready.system.projector.n_segments,
        active_voxels=ready.system.projector.active.size,
        course=[list(entry) for entry in zip(*columns, strict=True)] if keep else None,
    )


def _default(seen: Scene) -> Run:
    """Run the default, which chooses without the truth and stops by itself."""
    with tempfile.TemporaryDirectory() as folder:
        outcome = reconstruct(seen.saved(Path(folder)), seed=seen.seed)
    found = outcome.reconstruction
    chosen = {k: v for k, v in found.settings.items() if k not in ("tried", "chosen_by")}
    solving = outcome.seconds["solve"] - outcome.seconds["choose"]
    total = seconds_of(outcome)
    return Run(
        seen.flame,
        seen.views,
        seen.noise,
        seen.seed,
        AUTO,
        chosen,
        best_pass=len(found.history) - 1,
        passes=len(found.history) - 1,
        cosine_distance=found.quality["cosine_distance"],
        nrmse=found.quality["nrmse"],
        seconds=total,
        prepare_seconds=total - solving,
        segments=outcome.counts["segments"],
        active_voxels=outcome.counts["active_voxels"],
    )


def seconds_of(outcome: Any) -> float:
    """Return the seconds from images in memory to the volume, without what is judged after."""
    others = sum(outcome.seconds[key] for key in ("load", "compare", "condition"))
    return outcome.seconds["total"] - others
