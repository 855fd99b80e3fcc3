"""The last solve of a method that learns weights of boxes: by splines, with what was learned."""

from __future__ import annotations

import math
from dataclasses import replace

from tomo.operators import LINEAR, VOXEL, LinearSystem
from tomo.pipeline.basis import Basis, better_of
from tomo.pipeline.evaluate import as_learned
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.options import Options
from tomo.pipeline.run import Run
from tomo.solvers import Iteration, Solution


def solved_once_more(
    system: LinearSystem, basis: Basis, run: Run, found: Solution, options: Options
) -> tuple[LinearSystem, Basis, Run, Solution]:
    """Return all four of splines where those predict left-out views better by what was learned.

    Weights are learned of boxes where views are many. What a segment's light loses on its way is
    the same whether its voxel is even or not, so that they hold for splines too. Where nothing was
    learned, the chords do. The choice, and the solve, are those of the default method.

    Parameters
    ----------
    system : LinearSystem
        Of chords.
    basis : Basis
        What ``found`` is of. Left as it is where it was asked for, judged, or nothing is learned.
    run : Run
        That solved for ``found``, and nothing since.
    found : Solution
    options : Options
    """
    settled = options.basis != AUTO or not math.isnan(basis.share)
    if settled or basis.name != VOXEL or "learned" not in found.settings:
        return system, basis, run, found
    learned = as_learned(system, found, same_views=True)
    better, basis = better_of(learned, run.measured, options.supersample)
    if basis.name != LINEAR:
        return system, basis, run, found
    last_run = run.through(better.projector)
    last = last_run.solve(method_named(AUTO), None)
    chords = better
    if found.weights is not None:
        lengths = system.projector.segments.length
        chords = replace(better, projector=better.projector.with_lengths(lengths))
    distances = [
        (*course, *ending[-1:])
        for course, ending in zip(run.cosine_distances, last_run.cosine_distances, strict=True)
    ]
    run = run.through(chords.projector, distances)
    return chords, basis, run, _followed_by(found, last)


def _followed_by(learned: Solution, last: Solution) -> Solution:
    """Return what was learned with the volume of the solve that came after it."""
    seconds = {name: taken + last.seconds[name] for name, taken in learned.seconds.items()}
    end = Iteration(learned.history[-1].index + 1, last.relative_residual, seconds["total"])
    return replace(
        learned,
        volume=last.volume,
        history=(*learned.history, end),
        settings={**learned.settings, "solved_by": dict(last.settings)},
        stop_reason=f"{learned.stop_reason}; by splines: {last.stop_reason}",
        quality=last.quality,
        seconds=seconds,
    )
