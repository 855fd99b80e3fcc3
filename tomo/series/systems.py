"""The equations of a block of frames: one operator, and each frame's pixels and weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tomo.pipeline.build import WeightedSystem, in_basis, weigh_images
from tomo.pipeline.check_options import methods_of
from tomo.pipeline.evaluate import system_apart, trace_apart
from tomo.pipeline.frames import FrameImages, usable_in_all
from tomo.pipeline.place import at_device
from tomo.pipeline.register import hull_of_frames
from tomo.pipeline.trace import through_gas, trace_views
from tomo.series.plan import BlockSystem, Plan


def system_of_block(plan: Plan, frames: Sequence[FrameImages]) -> BlockSystem:
    """Return the equations of a block: over the union of its frames' hulls, of common pixels.

    Those of the plan serve where the block asks for the same voxels and pixels.
    """
    rig, noise = plan.registered.rig, plan.registered.noise
    active, seen = hull_of_frames(
        rig, frames, plan.grid, plan.registered.rule, noise, plan.system.active
    )
    usable = usable_in_all([frame.masks for frame in frames])
    pixels = tuple(usable_in_all([seen, usable]))
    known = plan.system
    if np.array_equal(active.mask, known.active.mask) and all(
        map(np.array_equal, pixels, known.pixels)
    ):
        return known
    key = frames[len(frames) // 2]
    screened = replace(
        plan.screened,
        images=key.images,
        masks=usable,
        apart_images=key.apart_images,
        apart_masks=usable_in_all([frame.apart_masks for frame in frames]),
    )
    registered = replace(plan.registered, active=active, masks=pixels)
    traced = trace_views(screened, registered, plan.grid, plan.options)
    apart = trace_apart(screened, traced.system, plan.options)
    of_plan = known.built
    found = plan.screened.corrections
    system, _ = in_basis(
        traced.system, of_plan.basis.name, plan.options.supersample, "", found and found.blur
    )
    system = through_gas(system, of_plan.absorption, plan.emission, plan.options)
    methods = methods_of(plan.options)
    system, place = at_device(system, plan.options, methods)
    built = replace(of_plan, system=system, choice=None, place=place)
    if apart is not None:
        apart = system_apart(apart, built, plan.emission, plan.options)
        apart, _ = at_device(apart, plan.options, methods)
    return BlockSystem(built, apart, active, pixels)


def weighted(plan: Plan, system: BlockSystem, frame: FrameImages) -> WeightedSystem:
    """Return the equations with the pixels of one frame, and weights."""
    known, of_block = plan.system.built, system.built.system
    weights = None
    if known.weighting["used"]:
        found = weigh_images(
            plan.registered.rig, plan.grid, frame.images, frame.masks, plan.registered.noise
        )
        weights = None if found.images is None else of_block.flatten(found.images)
    return replace(system.built, measured=of_block.flatten(frame.images), weights=weights)
