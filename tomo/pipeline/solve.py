"""Stage 7, solve: by a named method or as smooth as pixels allow; compare others with it.

Gas that absorbs its own light is solved for until it absorbs what it emits.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import host
from tomo._compute.reductions import norm
from tomo.operators import LinearSystem
from tomo.operators.operator import ProjectionOperator
from tomo.operators.system import Progress
from tomo.pipeline.build import BLOCK, WeightedSystem
from tomo.pipeline.check_options import learning_of
from tomo.pipeline.declared import comparison
from tomo.pipeline.methods import AUTO, Method, method_named
from tomo.pipeline.options import Options
from tomo.pipeline.place import training_device
from tomo.pipeline.stage import Record, as_warning, timed
from tomo.pipeline.trace import through_gas
from tomo.selection import Choice, choose_by_left_out_pixels, solve_as_chosen
from tomo.selection.smooth_solve import smooth_start
from tomo.solvers import Solution
from tomo.uncertainty import Solve

SOLVE = "solve"
"""The stage that solves, once it is known how smooth."""

Watch = Callable[[NDArray[np.float32]], float]
"""Called with the voxels' means ``(nx, ny, nz)`` after every iteration; what it returns becomes
`Iteration.distance`."""


@dataclass(frozen=True, eq=False)
class Solved:
    """The solution, whose volume holds voxels' means, and the equations that re-project it."""

    solution: Solution
    built: WeightedSystem
    record: Record = Record()

    @cached_property
    def system(self) -> LinearSystem:
        """The equations with the learned weights, where there are any."""
        return with_learned_weights(self.built.system, self.solution)


def solve(
    built: WeightedSystem,
    options: Options,
    *,
    watch: Watch | None = None,
    begin: Callable[[str], Progress | None] = lambda where: None,
) -> Solved:
    """Solve the equations by the method of the options; ``begin`` is told what begins."""
    with timed() as stage:
        method = method_named(options.method)
        found = solve_by(method, options.iterations, built, options, watch, begin)
        learning = learning_of(options)
        if learning is not None and learning.files.save_encoder is not None:
            stage.warnings += _save_encoder(found, learning.files.save_encoder)
    return Solved(found, built, stage.record)


@dataclass(frozen=True, eq=False)
class Compared:
    """The solutions of further methods, for the same equations."""

    solutions: tuple[Solution, ...]
    record: Record = Record()


def compare(
    built: WeightedSystem,
    options: Options,
    *,
    watch: Watch | None = None,
    progress: Progress | None = None,
) -> Compared:
    """Solve the equations by the methods to compare with; one that fails is a warning."""
    solutions = []
    with timed() as stage:
        for name, iterations in map(comparison, options.compare):
            with as_warning(f"comparison {name}", stage.warnings):
                method = method_named(name)
                solutions.append(
                    solve_by(method, iterations, built, options, watch, lambda where: progress)
                )
    return Compared(tuple(solutions), stage.record)


def solve_by(
    method: Method,
    iterations: int | None,
    built: WeightedSystem,
    options: Options,
    watch: Watch | None = None,
    begin: Callable[[str], Progress | None] = lambda where: None,
) -> Solution:
    """Solve the equations by one method; the volume holds the voxels' means."""
    started = time.perf_counter()
    limit = math.inf if options.time_limit is None else options.time_limit
    projector = built.system.projector
    projector = projector if method.through_lenses else projector.without_blur
    distances: dict[int, float] = {}

    def note(index: int, unknowns: NDArray[np.float32], _residual: float) -> bool:
        if watch is not None:
            distances[index] = watch(voxel_means_of(projector, unknowns))
        if progress:
            progress(index, total, name)
        return index > 0 and time.perf_counter() - solving > limit

    extra: dict[str, Any] = {}
    if method.name == AUTO:
        choice = built.choice or choose_by_left_out_pixels(
            projector,
            built.measured,
            blocks=built.system.blocks(BLOCK),
            weights=built.weights,
            progress=begin("smoothness"),
        )
        if iterations is not None:
            choice = replace(choice, iterations=iterations)
        name, total, solving = choice.method, choice.iterations, time.perf_counter()
        extra = {"chosen_by": "auto", "tried": choice.tried}
        progress = begin(SOLVE)
        found = solve_as_chosen(
            projector, built.measured, choice, weights=built.weights, callback=note
        )
    else:
        total = method.default_iterations if iterations is None else iterations
        name, solving, progress = method.name, started, begin(SOLVE)
        arguments = _arguments(method, iterations, built, options)
        found = method.solver(projector, built.measured, callback=note, **arguments)
    ended = time.perf_counter()
    return replace(
        found,
        volume=voxel_means_of(projector, projector.active.compress(found.volume)),
        history=tuple(replace(one, distance=distances.get(one.index)) for one in found.history),
        settings={**found.settings, **extra},
        seconds={**found.seconds, "choose": solving - started, "total": ended - started},
    )


def choice_of(solved: Solved) -> Choice:
    """Return how the default solved, with learned weights too, to solve the same way again."""
    how, iterations = solved.solution.settings, solved.solution.history[-1].index
    if "solved_by" in how:  # after weights were learned
        how = how["solved_by"]
        iterations = how["iterations"]
    return Choice(how["smooth_width"], how["strength"], iterations, math.nan)


def repeatable(solved: Solved, options: Options) -> Solve | None:
    """Return the solve with as many iterations, for other images; None if it has no operator.

    From the pixels ``(pixels,)`` to the voxels' means, the unknowns ``(unknowns,)`` of
    ``on_voxel_means``. The default starts where the found volume started, from all pixels.
    """
    method, found = method_named(options.method), solved.solution
    if method.needs_midpoints and not method.starts_from_default:
        return None
    projector, weights = solved.system.projector, solved.built.weights
    iterations = found.history[-1].index

    @cache
    def start_of_all() -> NDArray[np.float32]:
        return smooth_start(projector, solved.built.measured)

    def again(measured: NDArray[np.float32]) -> NDArray[np.float32]:
        if method.starts_from_default:
            how = {"weights": weights, "start": start_of_all()}
            repeated = solve_as_chosen(projector, measured, choice_of(solved), **how)
        else:
            arguments = method.arguments(seed=options.seed, iterations=iterations)
            repeated = method.solver(projector, measured, **arguments)
        volume = voxel_means_of(projector, projector.active.compress(repeated.volume))
        return projector.on_voxel_means.active.compress(volume)

    return again


def with_learned_weights(system: LinearSystem, found: Solution) -> LinearSystem:
    """Return the system with the weights that a solution learned, where there are any."""
    if found.weights is None:
        return system
    return replace(system, projector=found.weights.projector(system.projector))


def voxel_means_of(
    projector: ProjectionOperator, unknowns: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the mean emission in every voxel, ``(nx, ny, nz)``, zero where no ray crosses."""
    active, shape = projector.active, projector.grid.shape
    # smooth bases and penalties carry light there, which held-out cameras would see
    crossed = projector.column_sums > 0
    seen = np.where(crossed, host(unknowns), np.float32(0))
    means = projector.voxel_means(active.expand(seen).reshape(shape))
    return np.where(active.expand(~crossed).reshape(shape), np.float32(0), means)


def _arguments(
    method: Method, iterations: int | None, built: WeightedSystem, options: Options
) -> dict[str, Any]:
    """Return the arguments of a method's solver."""
    learning: dict[str, Any] = {}
    if method.takes("device"):
        learning["device"] = training_device(options.device)
    asked = learning_of(options) if method.name == options.method else None
    if asked is not None:
        learning |= asked.arguments
    if method.starts_from_default:
        learning["weights"] = built.weights
        learning["pixel_blocks"] = built.system.blocks(BLOCK)
        learning["refused"] = options.refused
    return method.arguments(**learning, seed=options.seed, iterations=iterations)


def _save_encoder(found: Solution, path: str) -> list[str]:
    """Write the encoder that a solve trained; return a line if it trained none."""
    from tomo.wernet import save_encoder

    if found.encoder is None:
        return [
            f"save_encoder: {path} was not written: no encoder was trained. "
            "Use a method that trains one (--method wernet), or leave save_encoder out"
        ]
    save_encoder(found.encoder, path)
    return []


OUTER = 3
"""Solves at most, each through gas with the emission of the one before."""

SETTLED = 1e-3
"""Relative change of the predicted images by other emission in front, below which another solve
is in vain: noise is larger."""


def with_own_absorption(solved: Solved, options: Options) -> Solved:
    """Return the solution seen through gas of its own emission, where gas absorbs by it."""
    absorption = solved.built.absorption
    if not absorption.emission:
        return solved
    for _ in range(OUTER):  # the first solve was through gas of a quick volume
        built, volume = solved.built, solved.solution.volume
        system = through_gas(built.system, absorption, volume, options)
        old, new = (one.on_voxel_means.projector for one in (built.system, system))
        unknowns = new.active.compress(volume)
        before, after = old @ unknowns, new @ unknowns
        solved = replace(solved, built=replace(built, system=system))
        again = repeatable(solved, options)
        if again is None or norm(after - before) <= SETTLED * norm(after):
            break
        found = again(built.measured)
        residual = norm(built.measured - new @ found) / (norm(built.measured) or 1.0)
        history = solved.solution.history
        last = replace(history[-1], relative_residual=float(residual))
        volume = new.active.expand(found).reshape(new.grid.shape).astype(np.float32)
        solution = replace(solved.solution, volume=volume, history=(*history[:-1], last))
        solved = replace(solved, solution=solution)
    return solved
