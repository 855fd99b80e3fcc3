"""How solvers converge to the truth, and the classic methods that others are compared with."""

from __future__ import annotations

import statistics
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from studies.common.scans import Problem
from studies.common.timing import Stopwatch
from tomo import metrics, solvers
from tomo.operators import LINEAR, VOXEL, GaussianBasis
from tomo.solvers.curvature import FIRST

PATIENCE = 4  # passes without a new best after which a run is over


@dataclass(frozen=True)
class Convergence:
    """What happened after each pass; entry 0 is the start."""

    seconds: tuple[float, ...]  # since the images were in memory: tracing included, judging not
    cosine_distances: tuple[float, ...]
    nrmses: tuple[float, ...]

    @property
    def best(self) -> int:
        """The pass of smallest cosine distance: where to stop, could one see the truth."""
        return int(np.argmin(self.cosine_distances))

    @property
    def least(self) -> float:
        """The smallest cosine distance."""
        return self.cosine_distances[self.best]

    def seconds_to(self, distance: float) -> float | None:
        """Return when the cosine distance first was at most ``distance``; None if it never was."""
        reached = np.flatnonzero(np.array(self.cosine_distances) <= distance)
        return self.seconds[int(reached[0])] if len(reached) else None


def converged(
    problem: Problem,
    truth: NDArray[np.float32],
    method: str,
    settings: Mapping[str, object],
    *,
    passes: int,
    width: float = 0.0,
    least_passes: int = 0,
    by_nrmse: bool = False,
) -> Convergence:
    """Run a method until it gets no better for `PATIENCE` passes; judge it after each.

    ``width``, in voxels, is that of the blobs of a `tomo.operators.GaussianBasis`; 0: voxels.
    ``least_passes`` are done whatever comes of them, for methods that change on their way.
    ``by_nrmse``: the NRMSE, not the cosine distance, says what is better.
    """
    reached: list[tuple[float, float, float]] = []
    projector = problem.system.projector
    watch = Stopwatch()
    basis = GaussianBasis(projector, width) if width else None

    def judge(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
        with watch.paused() as solving:
            values = basis.to_voxels(volume) if basis else volume
            found = projector.voxel_means(projector.active.expand(values).reshape(truth.shape))
            distance = metrics.cosine_distance(found, truth)
            reached.append((problem.seconds + solving, distance, metrics.nrmse(found, truth)))
            best = int(np.argmin([r[2 if by_nrmse else 1] for r in reached]))
            return index - max(best, least_passes) >= PATIENCE

    solver: Callable = getattr(solvers, method)
    solver(basis or projector, problem.measured, iterations=passes, callback=judge, **settings)
    return Convergence(*(tuple(column) for column in zip(*reached, strict=True)))


class Candidate(NamedTuple):
    """A method, the width of its blobs in voxels (0: none), its settings, and what of."""

    method: str
    width: float = 0.0
    settings: Mapping[str, Any] = {}
    basis: str = VOXEL

    @property
    def name(self) -> str:
        """As a table has it."""
        parts = [self.method]
        if self.width:
            parts.append(f"width {self.width:g}")
        if "strength" in self.settings:
            parts.append(f"strength {self.settings['strength']:g}")
        if self.basis != VOXEL:
            parts.append(self.basis)
        return ", ".join(parts)


INFORMED: tuple[Candidate, ...] = (
    Candidate("cgls"),
    Candidate("nnls"),
    Candidate("nnls", 0.5),
    Candidate("nnls", 0.8),
    Candidate("curvature", settings={"strength": 0.001}),
    Candidate("curvature", settings={"strength": 0.0001}, basis=LINEAR),
    Candidate("curvature", settings={"strength": 0.001}, basis=LINEAR),
)
CLASSIC: tuple[Candidate, ...] = (
    *INFORMED,
    Candidate("nnls", 1.2),
    Candidate("sirt", settings={"relaxation": 1.9, "subsets": 8}),
    Candidate("mlem", settings={"subsets": 8}),
    Candidate("tv", settings={"strength": 0.0002}),
    Candidate("tv", settings={"strength": 0.001}),
    Candidate("tv", settings={"strength": 0.005}),
    Candidate("curvature", settings={"strength": 0.01}),
    Candidate("nnls", basis=LINEAR),
    Candidate("curvature", settings={"strength": 0.01}, basis=LINEAR),
)


def in_linear_basis(ready: Problem) -> Problem:
    """Return the same problem in the linear basis; its set-up counts."""
    started = time.perf_counter()
    system = ready.system.with_linear_basis()
    return replace(ready, system=system, seconds=ready.seconds + time.perf_counter() - started)


def convergence_of(
    problems: Mapping[str, Problem],
    truth: NDArray[np.float32],
    candidates: Sequence[Candidate],
    passes: int,
) -> dict[str, Convergence]:
    """Return how each candidate went for whose basis there is a problem."""
    return {
        one.name: converged(
            problems[one.basis],
            truth,
            one.method,
            one.settings,
            passes=passes,
            width=one.width,
            least_passes=FIRST if one.method == "curvature" else 0,
        )
        for one in candidates
        if one.basis in problems
    }


def means(rows: Sequence[Mapping[str, Any]], *keys: str) -> list[dict[str, Any]]:
    """Return a row for those that are alike in ``keys``: means of numbers over their seeds.

    Words are joined, the most frequent first; anything else is that of the first seed.
    """
    groups: dict[tuple, list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    found = []
    for group in groups.values():
        mean = {key: group[0][key] for key in keys} | {"seeds": len(group)}
        for key in (key for key in group[0] if key not in mean and key != "seed"):
            values = [row[key] for row in group]
            if isinstance(values[0], str):
                mean[key] = " / ".join(name for name, _ in Counter(values).most_common())
            elif isinstance(values[0], int | float):
                mean[key] = statistics.fmean(values)
            else:
                mean[key] = values[0]
        found.append(mean)
    return found
