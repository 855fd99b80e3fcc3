"""Settling how frames are filtered in time, from windows of frames spread over the series."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from tomo.pipeline.basis import BLOCK
from tomo.pipeline.options import OFF
from tomo.selection.choose import Choice
from tomo.series.frames import reader_of, spread
from tomo.series.plan import Plan
from tomo.series.solving import solved_together
from tomo.series.systems import system_of_block, weighted
from tomo.series.temporal import REACH, TemporalFilter
from tomo.series.temporal_choice import WINDOW, TemporalChoice, Window, choose_filter, leave_out

LEAST_VIEWS = 2
"""Views up to which none can be left out: one alone says nothing of another."""

WINDOWS = 2
"""Windows, spread over the series. More: planning takes long. Fewer: one odd moment decides."""


def settle_filter(
    plan: Plan, choice: Choice, stage: Callable[[str], object] = lambda words: None
) -> TemporalChoice:
    """Return whether and how frames are to be filtered in time.

    Parameters
    ----------
    plan : Plan
    choice : Choice
        How smooth volumes are.
    stage : callable, optional
        Receives what is done.
    """
    wanted, count = plan.options.temporal, len(plan.places)
    if wanted == OFF:
        return TemporalChoice(None, "it was asked for")
    if plan.system.built.absorption.emission:
        return TemporalChoice(None, "the gas absorbs its own light: frames are solved repeatedly")
    if not isinstance(wanted, str):
        return TemporalChoice(TemporalFilter.gaussian(wanted), "it was asked for")
    if count <= 2 * REACH:
        return TemporalChoice(None, f"{count} frames are too few to see what neighbours say")
    views = len(plan.registered.rig)
    if views <= LEAST_VIEWS:
        return TemporalChoice(None, f"{views} views are too few to leave one out")
    windows, length = [], min(WINDOW, count)
    enough = count >= WINDOWS * length
    for number, middle in enumerate(spread(count, WINDOWS if enough else 1)):
        stage(f"what neighbouring frames say, {number + 1} of {WINDOWS}")
        first = min(max(middle - length // 2, 0), count - length)
        view = spread(views, WINDOWS)[number]
        found = _window(plan, choice, range(first, first + length), view)
        windows += [] if found is None else [found]
    if not windows:
        return TemporalChoice(None, "too few frames around the key frames can be read")
    return choose_filter(windows)


def _window(plan: Plan, choice: Choice, places: range, view: int) -> Window | None:
    """Return the solutions of some frames without one view; None if most cannot be read."""
    read = reader_of(plan.scan, plan.screened, plan.options.skip_bad)
    both = {place: read(plan.places[place]) for place in places}
    frames = {place: one for place, one in both.items() if one is not None}
    if len(frames) <= 2 * REACH:
        return None
    system = system_of_block(plan, list(frames.values()))
    whole = system.built.system
    fold, held = leave_out(view, whole.projector, whole.blocks(BLOCK))
    part = replace(whole, projector=fold.training)
    training, left_out, weights = [], {}, {}
    for place, frame in frames.items():
        built = weighted(plan, system, frame)
        left_out[place] = built.measured[held]
        weights[place] = None if built.weights is None else built.weights[held]
        own = None if built.weights is None else built.weights[~held]
        training.append(replace(built, system=part, measured=built.measured[~held], weights=own))
    found = solved_together(plan, training, choice)
    solutions = {place: unknowns for place, (_, unknowns) in zip(frames, found, strict=True)}
    seen = {place: one.measured for place, one in zip(frames, training, strict=True)}
    seen_weights = {place: one.weights for place, one in zip(frames, training, strict=True)}
    return Window(fold, solutions, left_out, weights, seen, seen_weights)
