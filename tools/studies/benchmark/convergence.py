"""How a solver converges: its distance from the truth after each pass, and when."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.common.problems import Problem
from studies.common.timing import Stopwatch
from tomo import metrics, solvers
from tomo.operators import GaussianBasis

PATIENCE = 4
"""Passes without a new best after which a run is over."""


@dataclass(frozen=True)
class Convergence:
    """What happened after each pass; entry 0 is the start.

    Attributes
    ----------
    seconds : tuple of float
        Since the images were in memory: tracing included, judging not.
    cosine_distances, nrmses : tuple of float
    """

    seconds: tuple[float, ...]
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

    Parameters
    ----------
    problem : Problem
    truth : (nx, ny, nz) float32
    method : str
        One of `tomo.solvers.METHODS`.
    settings : mapping
        Its further arguments.
    passes : int
        The most.
    width : float
        Of the blobs of a `tomo.operators.GaussianBasis`, in voxels; the voxel basis when 0.
    least_passes : int
        As many are done whatever comes of them, for methods that change on their way.
    by_nrmse : bool
        Whether the NRMSE, not the cosine distance, says what is better.
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
