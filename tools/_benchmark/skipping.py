"""What leaving out of what cannot matter saves, and whether the volume gets worse."""

from __future__ import annotations

import itertools
import statistics
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from _benchmark.courses import course
from _benchmark.problems import problem
from _benchmark.scenes import scene
from _benchmark.sizes import Sizes
from _benchmark.solvers import Progress, seconds_of
from tomo import solvers
from tomo.pipeline import reconstruct

REACHED = 1e-3
METHODS = ("sart", "cgls", "nnls")
NOISES = ("clean", "gaussian")
SEED = 1


@dataclass(frozen=True)
class Skipped:
    """One method on one scene with or without skipping.

    Attributes
    ----------
    flame, noise, method : str
        Method ``auto`` is the default, which stops by itself; the others are best-stopped.
    skip : bool
    segments, active_voxels : int
    prepare_seconds, seconds : float
        Tracing and what comes before it; until the best pass or the default's end. Medians.
    seconds_to_1e3 : float or None
        Since the images were in memory.
    cosine_distance, nrmse : float
    """

    flame: str
    noise: str
    method: str
    skip: bool
    segments: int
    active_voxels: int
    prepare_seconds: float
    seconds: float
    seconds_to_1e3: float | None
    cosine_distance: float
    nrmse: float


def skipping(sizes: Sizes, progress: Progress) -> list[dict[str, Any]]:
    """Return a row for each flame, noise, method, and skipping on and off."""
    methods = [method for method in METHODS if method in solvers.METHODS]
    cases = list(itertools.product(sizes.flames, NOISES, [*methods, "auto"]))
    rows = []
    for number, (flame, noise, method) in enumerate(cases):
        progress(number, len(cases), f"{flame}, {noise}, {method}, with and without skipping")
        seen = scene(flame, 33, noise, SEED, sizes, sizes.skip_shrink)
        if method == "auto":
            rows += [_default(seen, skip) for skip in (True, False)]
        else:
            rows += _best_stopped(seen, method, sizes)
    progress(len(cases), len(cases), "")
    return [asdict(row) for row in rows]


def _best_stopped(seen: Any, method: str, sizes: Sizes) -> list[Skipped]:
    """Return the rows with and without skipping, run in turn."""
    found: dict[bool, list] = {True: [], False: []}
    for _ in range(min(sizes.repeats, 3)):
        for skip, results in found.items():
            ready = problem(seen.scan.rig, seen.scan.grid, seen.images, skip=skip)
            went = course(ready, seen.scan.truth, method, {}, passes=min(sizes.passes, 20))
            results.append((ready, went))
    rows = []
    for skip, results in found.items():
        ready, went = results[-1]
        reached = [w.seconds_to(REACHED) for _, w in results]
        rows.append(
            Skipped(
                seen.flame,
                seen.noise,
                method,
                skip,
                segments=ready.system.projector.n_segments,
                active_voxels=ready.system.projector.active.size,
                prepare_seconds=statistics.median(r.seconds for r, _ in results),
                seconds=statistics.median(w.seconds[w.best] for _, w in results),
                seconds_to_1e3=None if None in reached else statistics.median(reached),
                cosine_distance=went.least,
                nrmse=went.nrmses[went.best],
            )
        )
    return rows


def _default(seen: Any, skip: bool) -> Skipped:
    with tempfile.TemporaryDirectory() as folder:
        outcome = reconstruct(seen.saved(Path(folder)), skip=skip)
    found = outcome.reconstruction
    distances = outcome.cosine_distances[0]
    total = seconds_of(outcome)
    ended = found.history[-1].seconds if found.history else 0.0
    first = next((i for i, d in enumerate(distances) if d <= REACHED), None)
    reached = None if first is None else total - ended + found.history[first].seconds
    return Skipped(
        seen.flame,
        seen.noise,
        "auto",
        skip,
        segments=outcome.counts["segments"],
        active_voxels=outcome.counts["active_voxels"],
        prepare_seconds=outcome.seconds["prepare"] + outcome.seconds["trace"],
        seconds=total,
        seconds_to_1e3=reached,
        cosine_distance=found.quality["cosine_distance"],
        nrmse=found.quality["nrmse"],
    )
