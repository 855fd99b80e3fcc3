"""The classic methods that a default, or WERNet, is compared with: each stopped by the truth."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from studies.benchmark.convergence import Convergence, converged
from studies.common.problems import Problem
from tomo.operators import LINEAR, VOXEL
from tomo.solvers.curvature import FIRST


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
