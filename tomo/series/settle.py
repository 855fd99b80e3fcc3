"""Settling a plan from a few key frames, by the stages of `tomo.pipeline`.

Pixels and which cameras take part are settled from the mean of the key frames; gains, absorption,
where cameras look, how much is carved and how smooth volumes are from the frames themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rigs.progress import staged
from tomo.grid import VoxelGrid
from tomo.operators.gpu.names import settled
from tomo.operators.system import Progress
from tomo.pipeline.build import BLOCK
from tomo.pipeline.check_options import cameras_to_refine, check_cameras, check_options, methods_of
from tomo.pipeline.coarse import FEWEST_VIEWS
from tomo.pipeline.evaluate import counted, read_reference, system_apart
from tomo.pipeline.first_use import warm_up_stages
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.place import at_device
from tomo.pipeline.prepare import prepare
from tomo.pipeline.screen import FrameImages
from tomo.pipeline.solve import solve
from tomo.pipeline.view import peak_of
from tomo.scan import Scan
from tomo.selection import choose_by_left_out_pixels
from tomo.selection.choose import Choice
from tomo.series.frames import read_frame, readable_keys, reader_of, spread
from tomo.series.plan import BlockSystem, Plan, system_of_block, weighted
from tomo.series.solving import solved_together
from tomo.series.temporal import REACH, TemporalFilter
from tomo.series.temporal_choice import WINDOW, TemporalChoice, Window, choose_filter, leave_out

CHOOSING = 3
"""Key frames of which each says how smooth volumes are to be. More: planning takes long, though
frames of one film agree. Fewer: one odd frame decides for all."""


def check_series_options(options: Options, scan: Scan, grid: VoxelGrid | None) -> None:
    """Refuse options that a series cannot follow, see `check_options` for the others."""
    check_options(options, scan, grid)
    for name in ("compare", "time_limit"):
        if asked := getattr(options, name):
            raise ValueError(
                f"{name}: found {asked!r} with frames, expected it for one frame alone"
            )
    if options.uncertainty not in (0, AUTO):
        raise ValueError(
            f"uncertainty: found {options.uncertainty} repeats with frames, expected 0 or auto: "
            "reconstruct single frames, --frame, for their uncertainty"
        )
    if method_named(options.method).name != AUTO and options.temporal not in (AUTO, OFF):
        raise ValueError(
            f"temporal: found {options.temporal:g} with method {options.method}, expected it "
            "with method auto: frames are solved by themselves otherwise"
        )
    if method_named(options.method).needs_midpoints:
        raise ValueError(
            f"method: found {options.method} with frames, expected a method that learns nothing"
        )


def make_plan(
    scan: Scan,
    grid: VoxelGrid,
    options: Options,
    places: Sequence[int],
    progress: Progress | None = None,
) -> Plan:
    """Settle everything that is settled once, from key frames spread over the frames."""
    stage, doubts = staged(progress), check_cameras(scan, grid, options)
    stage("compiling")
    warm_up_stages(options.tracer, carving=options.skip)
    stage("reading key frames")
    keys = readable_keys(scan, places, options)
    loaded = [read_frame(scan, place) for place in keys]
    cameras = cameras_to_refine(options, scan)
    ready = prepare(scan, grid, options, loaded, cameras, stage)
    screened, registered, built = ready.screened, ready.registered, ready.built
    absorbs = built.absorption.emission
    emission, apart = solve(built, options).solution.volume if absorbs else None, ready.apart
    options = replace(options, device=settled(options.device, built.place))
    if apart is not None:
        apart = system_apart(apart, built, emission, options)
        apart, _ = at_device(apart, options, methods_of(options))
    system = BlockSystem(built, apart, registered.active, tuple(registered.masks))
    truth = read_reference(scan, grid, scan.frames[keys[0]].name)
    done = (*ready.records.values(), truth.record)
    masks = counted(loaded[0], screened)
    peak = peak_of(scan, loaded[0].frame, [one.images for one in loaded], masks, options)
    plan = Plan(
        scan, grid, options, tuple(places), keys, screened, registered, system,
        emission, None, (), peak,
        (*doubts, *scan.remarks, *(line for one in done for line in one.warnings)),
    )  # fmt: skip
    if method_named(options.method).name != AUTO:
        return plan
    telling = [ready.frames[place] for place in spread(len(keys), CHOOSING)]
    choices = tuple(
        _choose(plan, system, frame, stage(f"smoothness {number} of {len(telling)}"))
        for number, frame in enumerate(telling, 1)
    )
    choice = middle(choices)
    plan = replace(plan, choices=choices, choice=choice)
    return replace(plan, temporal=settle_filter(plan, choice, stage))


def _choose(
    plan: Plan, system: BlockSystem, frame: FrameImages, progress: Progress | None = None
) -> Choice:
    """Return how smooth the volume of one frame is to be, see `choose_by_left_out_pixels`."""
    built = weighted(plan, system, frame)
    return choose_by_left_out_pixels(
        built.system.projector,
        built.measured,
        blocks=built.system.blocks(BLOCK),
        weights=built.weights,
        progress=progress,
    )


def middle(choices: Sequence[Choice]) -> Choice:
    """Return the middle one of some choices, ordered by strength, width and iterations."""
    # dark frames predict nothing
    telling = [one for one in choices if np.isfinite(one.held_out_residual)] or list(choices)
    order = sorted(telling, key=lambda one: (one.strength, one.width, one.iterations))
    return order[len(order) // 2]


WINDOWS = 2
"""Windows, spread over the series. More: planning takes long. Fewer: one odd moment decides."""


def settle_filter(
    plan: Plan, choice: Choice, stage: Callable[[str], object] = lambda words: None
) -> TemporalChoice:
    """Return whether and how frames are to be filtered in time."""
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
    if views < FEWEST_VIEWS:
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
    built = {place: weighted(plan, system, frame) for place, frame in frames.items()}
    part, rest = (replace(whole, projector=one) for one in (fold.training, fold.left_out))
    seen = {place: one.only(~held, part) for place, one in built.items()}
    left_out = {place: one.only(held, rest) for place, one in built.items()}
    found = solved_together(plan, list(seen.values()), choice)
    solutions = {place: unknowns for place, (_, unknowns) in zip(frames, found, strict=True)}
    return Window(fold, solutions, left_out, seen)
