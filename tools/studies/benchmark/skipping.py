"""What leaving out of what cannot matter saves, and whether the volume gets worse.

33 views without noise. `auto` is the default as it stops by itself, `nnls` is stopped nearest to
the truth; each is run with and without skipping in turn. Seconds are since the images were in
memory, of `nnls` medians.
"""

from __future__ import annotations

import itertools
import statistics
from typing import Any

from studies.benchmark.convergence import converged
from studies.benchmark.sizes import SIZES, Sizes
from studies.common.flames import Scene, scene
from studies.common.scans import problem, reconstructed, seconds_of
from studies.common.study import Request, Tables

REACHED = 1e-3  # cosine distance whose time is measured
METHODS = ("nnls", "auto")
SEED = 1


def run(request: Request) -> Tables:
    """Return a row for each flame, noise, method, and skipping on and off."""
    sizes = SIZES[request.size]
    cases = itertools.product(sizes.flames, METHODS)
    rows = []
    for flame, method in request.each(cases, ", ".join):
        seen = scene(flame, 33, "clean", SEED, sizes.shown)
        if method == "auto":
            rows += [_default(seen, skip) for skip in (True, False)]
        else:
            rows += _best_stopped(seen, method, sizes)
    return {"skipping": rows}


def _best_stopped(seen: Scene, method: str, sizes: Sizes) -> list[dict[str, Any]]:
    """Return the rows with and without skipping, run in turn."""
    found: dict[bool, list] = {True: [], False: []}
    for _ in range(min(sizes.repeats, 3)):
        for skip, results in found.items():
            ready = problem(seen.scan.rig, seen.scan.grid, seen.images, skip=skip)
            went = converged(ready, seen.scan.truth, method, {}, passes=min(sizes.passes, 20))
            results.append((ready, went))
    rows = []
    for skip, results in found.items():
        ready, went = results[-1]
        reached = [w.seconds_to(REACHED) for _, w in results]
        rows.append(
            {
                **seen.named,
                "method": method,
                "skip": skip,
                "segments": ready.system.projector.n_segments,
                "live_voxels": ready.system.projector.active.size,
                "prepare_seconds": statistics.median(r.seconds for r, _ in results),
                "seconds_to_1e3": None if None in reached else statistics.median(reached),
                "seconds": statistics.median(w.seconds[w.best] for _, w in results),
                "cosine_distance": went.least,
                "nrmse": went.nrmses[went.best],
            }
        )
    return rows


def _default(seen: Scene, skip: bool) -> dict[str, Any]:
    outcome = reconstructed(seen.scan, skip=skip)
    found, total = outcome.solution, seconds_of(outcome)
    ended = found.history[-1].seconds if found.history else 0.0
    first = next((i for i, one in enumerate(found.history) if one.distance <= REACHED), None)
    return {
        **seen.named,
        "method": "auto",
        "skip": skip,
        "segments": outcome.counts["segments"],
        "live_voxels": outcome.counts["active_voxels"],
        "prepare_seconds": outcome.seconds["register"] + outcome.seconds["trace"],
        "seconds_to_1e3": (
            None if first is None else total - ended + found.history[first].seconds
        ),
        "seconds": total,
        "cosine_distance": found.quality["cosine_distance"],
        "nrmse": found.quality["nrmse"],
    }
