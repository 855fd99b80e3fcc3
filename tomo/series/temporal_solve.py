"""The frames of a block, each from its own solution and those of its neighbours."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from tomo.pipeline.frames import FrameImages
from tomo.pipeline.solve import voxel_means_of
from tomo.selection.choose import Choice
from tomo.series.block_system import BlockSystem
from tomo.series.plan import Plan
from tomo.series.solving import FrameResult, compared, solved_together
from tomo.series.systems import weighted
from tomo.series.temporal import TemporalFilter, growth


def solve_filtered(
    plan: Plan,
    system: BlockSystem,
    own: Sequence[int],
    frames: Mapping[int, FrameImages],
    choice: Choice,
    temporal: TemporalFilter,
) -> Iterator[tuple[int, FrameResult]]:
    """Yield the places of a block's frames and their results, filtered in time.

    Parameters
    ----------
    plan : Plan
    system : BlockSystem
    own : sequence of int
        The places of the block's frames.
    frames : mapping
        Place to the images: of the block's frames, and of neighbours.
    choice : Choice
        How smooth.
    temporal : TemporalFilter
        How frames are filtered, see `Plan.filter`.
    """
    began = time.perf_counter()
    built = {place: weighted(plan, system, frame) for place, frame in frames.items()}
    found = dict(zip(frames, solved_together(plan, list(built.values()), choice), strict=True))
    solutions = {place: unknowns for place, (_, unknowns) in found.items()}
    projector = system.built.system.projector
    spent = (time.perf_counter() - began) / len(own)
    for place in own:
        now = time.perf_counter() - spent
        result, alone = found[place]
        unknowns, one = temporal.apply(projector.active, solutions, place), built[place]
        grown = growth(projector, one.measured, one.weights, alone, unknowns)
        if grown <= temporal.most:
            volume = voxel_means_of(projector, unknowns)
            result = replace(result, solution=replace(result.solution, volume=volume))
        yield place, compared(plan, system, frames[place], result, now)
