"""One system solved by one method after another, each judged against a truth if there is one."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo import metrics
from tomo.operators.operator import ProjectionOperator
from tomo.operators.system import Progress
from tomo.pipeline.methods import AUTO, Method
from tomo.pipeline.reconstruction import quality
from tomo.selection import Choice, choose_by_held_out_views
from tomo.selection.choose import solve_as_chosen
from tomo.solvers import Solution
from tomo.uncertainty import Solve


class Run:
    """Solves one system by one method after another, recording the distance from a truth.

    ``learning`` are arguments that only methods that learn take: device, encoder ...; ``weights``
    (pixels,) what pixels are worth to the default, and to a method that starts from it; None: all
    alike.
    """

    def __init__(
        self,
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        truth: NDArray[np.float32] | None,
        learning: Mapping[str, Any],
        seed: int,
        time_limit: float | None,
        progress: Progress | None,
        weights: NDArray[np.float32] | None = None,
    ) -> None:
        self.projector = projector
        self.measured = measured
        self.truth = truth
        self.learning = learning
        self.seed = seed
        self.time_limit = math.inf if time_limit is None else time_limit
        self.progress = progress
        self.weights = weights
        self.cosine_distances: list[tuple[float, ...]] = []

    def through(
        self, projector: ProjectionOperator, solved: Sequence[tuple[float, ...]] = ()
    ) -> Run:
        """Return a run by another projector of the same pixels, with the distances so far."""
        run = copy.copy(self)
        run.projector, run.cosine_distances = projector, list(solved)
        return run

    def solve(self, method: Method, iterations: int | None) -> Solution:
        """Run one method; its quality against the truth comes with it."""
        started = time.perf_counter()
        distances: list[float] = []

        def watch(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
            if self.truth is not None:
                distances.append(
                    metrics.cosine_distance(voxel_means_of(projector, volume), self.truth)
                )
            if self.progress:
                self.progress(index, total, name)
            return index > 0 and time.perf_counter() - solving > self.time_limit

        projector = self._projector_for(method)
        if method.name == AUTO:
            choice = choose_by_held_out_views(
                projector, self.measured, weights=self.weights, progress=self.progress
            )
            if iterations is not None:
                choice = replace(choice, iterations=iterations)
            name, total, solving = choice.method, choice.iterations, time.perf_counter()
            found = solve_as_chosen(
                projector, self.measured, choice, weights=self.weights, callback=watch
            )
            extra: dict[str, Any] = {"chosen_by": "auto", "tried": choice.tried}
        else:
            learning = {k: v for k, v in self.learning.items() if method.takes(k)}
            if method.starts_from_default:
                learning["weights"] = self.weights
            arguments = method.arguments(**learning, seed=self.seed, iterations=iterations)
            total = method.default_iterations if iterations is None else iterations
            name, solving = method.name, started
            found = method.solver(projector, self.measured, callback=watch, **arguments)
            extra = {}
        self.cosine_distances.append(tuple(distances))
        volume = voxel_means_of(projector, projector.active.compress(found.volume))
        return replace(
            found,
            volume=volume,
            settings={**found.settings, **extra},
            quality=quality(volume, self.truth),
            seconds={
                **found.seconds,
                "choose": solving - started,
                "total": time.perf_counter() - started,
            },
        )

    def again(self, method: Method, found: Solution) -> Solve | None:
        """Return ``found``'s solve, with as many iterations, for other images; None if it learns.

        From the pixels that take part, ``(pixels,)``, to the voxels' mean emission, the unknowns
        of the projector ``on_voxel_means``, ``(unknowns,)``.
        """
        if method.needs_midpoints:
            return None
        iterations = found.history[-1].index

        def solve(measured: NDArray[np.float32]) -> NDArray[np.float32]:
            if method.name == AUTO:
                name, width = found.settings["method"], found.settings["smooth_width"]
                strength = found.settings.get("strength")
                choice = Choice(name, width, iterations, math.nan, strength)
                repeated = solve_as_chosen(self.projector, measured, choice, weights=self.weights)
            else:
                arguments = method.arguments(seed=self.seed, iterations=iterations)
                repeated = method.solver(self.projector, measured, **arguments)
            volume = voxel_means_of(
                self.projector, self.projector.active.compress(repeated.volume)
            )
            return self.projector.on_voxel_means.active.compress(volume)

        return solve

    def _projector_for(self, method: Method) -> ProjectionOperator:
        """Return the projector, of the voxel basis for a method that goes ray by ray."""
        return self.projector if method.through_lenses else self.projector.without_blur


def voxel_means_of(
    projector: ProjectionOperator, unknowns: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the mean emission in every voxel, ``(nx, ny, nz)``, of ``unknowns``.

    Zero where no ray says anything. Smooth bases and penalties carry their neighbours' light into
    such voxels: not seen by the cameras reconstructed from, it would be seen by those held out.
    """
    seen = np.where(projector.column_sums > 0, unknowns, np.float32(0))
    return projector.voxel_means(projector.active.expand(seen).reshape(projector.grid.shape))
