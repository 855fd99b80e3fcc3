"""How soon a volume is exact when the data are: images projected through the very same matrix.

An inverse crime, on purpose: it shows how fast the arithmetic converges, not how good a
reconstruction of a flame is.
"""

from __future__ import annotations

import itertools
import statistics
from dataclasses import asdict, dataclass
from typing import Any

from _benchmark.courses import Course, course
from _benchmark.problems import problem
from _benchmark.scenes import scene
from _benchmark.sizes import Sizes
from _benchmark.solvers import Progress
from tomo import solvers

COARSE, FINE = 1e-3, 1e-6
MOST_SECONDS = 30.0
MOST_PASSES = 1500
CANDIDATES = (
    ("sirt", False, COARSE),
    ("sirt", True, COARSE),
    ("sart", True, FINE),
    ("cgls", False, FINE),
    ("cgls", True, FINE),
    ("nnls", False, FINE),
    ("nnls", True, FINE),
)
"""Method, whether to skip, and the cosine distance at which the run ends."""


@dataclass(frozen=True)
class Reached:
    """How soon one method reached a cosine distance; medians.

    Attributes
    ----------
    flame : str
    method : str
    skip : bool
    segments, active_voxels : int
    prepare_seconds : float
        Tracing and what comes before it.
    passes_to_1e3 : int or None
    seconds_to_1e3, seconds_to_1e6 : float or None
        Since the images were in memory; None where it was not reached.
    course : list of (seconds, cosine distance)
        Of the last repetition.
    """

    flame: str
    method: str
    skip: bool
    segments: int
    active_voxels: int
    prepare_seconds: float
    passes_to_1e3: int | None
    seconds_to_1e3: float | None
    seconds_to_1e6: float | None
    course: list


def consistent(sizes: Sizes, progress: Progress) -> list[dict[str, Any]]:
    """Return how soon skipped and unskipped methods reach 1e-3 and 1e-6."""
    candidates = [c for c in CANDIDATES if c[0] in solvers.METHODS]
    rows = []
    for number, flame in enumerate(sizes.flames):
        seen = scene(flame, 33, "clean", 0, sizes)
        rig, grid, truth = seen.scan.rig, seen.scan.grid, seen.scan.truth
        everything = problem(rig, grid, seen.images, skip=False).system
        images = everything.images(everything.projector @ truth.ravel())
        found: dict[tuple, list[tuple[Course, Any]]] = {c: [] for c in candidates}
        for turn, candidate in itertools.product(range(sizes.repeats), candidates):
            method, skip, until = candidate
            done = number * sizes.repeats * len(candidates) + turn * len(candidates)
            total = len(sizes.flames) * sizes.repeats * len(candidates)
            progress(done + candidates.index(candidate), total, f"{flame}, exact data, {method}")
            ready = problem(rig, grid, images, skip=skip)
            went = course(
                ready,
                truth,
                method,
                {},
                passes=MOST_PASSES,
                until=until,
                most_seconds=MOST_SECONDS if sizes.repeats > 1 else 0.5,
            )
            found[candidate].append((went, ready))
        rows += [_row(flame, *c[:2], pairs) for c, pairs in found.items()]
    return [asdict(row) for row in rows]


def _row(flame: str, method: str, skip: bool, pairs: list[tuple[Course, Any]]) -> Reached:
    courses = [went for went, _ in pairs]
    ready = pairs[-1][1]
    last = courses[-1]
    coarse = [c.seconds_to(COARSE) for c in courses]
    fine = [c.seconds_to(FINE) for c in courses]
    return Reached(
        flame,
        method,
        skip,
        segments=ready.system.projector.n_segments,
        active_voxels=ready.system.projector.active.size,
        prepare_seconds=statistics.median(problem.seconds for _, problem in pairs),
        passes_to_1e3=next((i for i, d in enumerate(last.cosine_distances) if d <= COARSE), None),
        seconds_to_1e3=None if None in coarse else statistics.median(coarse),
        seconds_to_1e6=None if None in fine else statistics.median(fine),
        course=[list(entry) for entry in zip(last.seconds, last.cosine_distances, strict=True)],
    )
