"""Settling a plan from a few key frames, by the stages of `tomo.pipeline`.

Pixels and which cameras take part are settled from the mean of the key frames; gains, absorption,
where cameras look, how much is carved and how smooth volumes are from the frames themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs.progress import staged
from tomo.grid import VoxelGrid
from tomo.operators.gpu.names import settled
from tomo.operators.system import Progress
from tomo.pipeline.basis import BLOCK
from tomo.pipeline.build import WeightedSystem
from tomo.pipeline.check_cameras import check_cameras
from tomo.pipeline.check_options import cameras_to_refine, check_options, methods_of
from tomo.pipeline.evaluate import counted, read_reference, system_apart
from tomo.pipeline.first_use import warm_up_stages
from tomo.pipeline.frames import FrameImages
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.peak import peak_of
from tomo.pipeline.place import at_device
from tomo.pipeline.prepare import prepare
from tomo.pipeline.solve import solve
from tomo.scan import Scan
from tomo.selection import choose_by_left_out_pixels
from tomo.selection.choose import Choice
from tomo.series.block_system import BlockSystem
from tomo.series.frames import read_frame, readable_keys, spread
from tomo.series.plan import Plan
from tomo.series.systems import weighted
from tomo.series.temporal_plan import settle_filter

CHOOSING = 3
"""Key frames of which each says how smooth volumes are to be. More: planning takes long, though
frames of one film agree. Fewer: one odd frame decides for all."""

REFUSED = {
    "compare": (),
    "time_limit": None,
}
"""Options that have no meaning for a series, with the values that do not ask for them."""


def check_series_options(options: Options, scan: Scan, grid: VoxelGrid | None) -> None:
    """Refuse options that a series cannot follow, see `check_options` for the others.

    Raises
    ------
    ValueError
        One line that names the option, what was found and what was expected.
    """
    check_options(options, scan, grid)
    for name, value in REFUSED.items():
        if getattr(options, name) != value:
            raise ValueError(
                f"{name}: found {getattr(options, name)!r} with frames, expected it for one frame "
                "alone"
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
    """Settle everything that is settled once, from key frames spread over the frames.

    Parameters
    ----------
    scan : Scan
    grid : VoxelGrid
    options : Options
    places : sequence of int
        The frames, by their places in the scan.
    progress : callable, optional
    """
    stage, doubts = staged(progress), check_cameras(scan, grid, options)
    stage("compiling")
    warm_up_stages(options.tracer, carving=options.skip)
    stage("reading key frames")
    keys = readable_keys(scan, places, options)
    loaded = [read_frame(scan, place, False) for place in keys]
    cameras = cameras_to_refine(options, scan)
    ready = prepare(scan, grid, options, loaded, cameras, stage)
    screened, registered, built = ready.screened, ready.registered, ready.built
    emission, apart = _emission(built, options), ready.apart
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
    """Return the middle one of some choices, ordered by strength, width and iterations.

    Those of dark frames, which predict nothing, do not count where there are others.
    """
    telling = [one for one in choices if np.isfinite(one.held_out_residual)] or list(choices)
    order = sorted(telling, key=lambda one: (one.strength, one.width, one.iterations))
    return order[len(order) // 2]


def _emission(built: WeightedSystem, options: Options) -> NDArray[np.float32] | None:
    """Return the emission of the mean where gas absorbs its own light."""
    return solve(built, options).solution.volume if built.absorption.emission else None
