"""The plan of a series, settled once for every frame, and the equations of its blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem
from tomo.operators.gpu import device_count, on_cpu
from tomo.operators.gpu.names import CPU, CUDA
from tomo.pipeline.build import WeightedSystem, in_basis, weigh_images
from tomo.pipeline.check_options import methods_of
from tomo.pipeline.evaluate import pixels_in_sight, system_apart, trace_apart
from tomo.pipeline.options import Options
from tomo.pipeline.place import at_device
from tomo.pipeline.register import Registered, hull_of_frames
from tomo.pipeline.report_json import plain
from tomo.pipeline.screen import FrameImages, ScreenedScan, usable_in_all
from tomo.pipeline.trace import through_gas, trace_views
from tomo.pipeline.view import Peak
from tomo.scan import Scan
from tomo.scan.images import Masks
from tomo.selection.choose import Choice
from tomo.series.temporal import TemporalFilter, with_neighbours
from tomo.series.temporal_choice import TemporalChoice
from tomo.uncertainty import view_coverage


@dataclass(frozen=True, eq=False)
class BlockSystem:
    """The equations that the frames of a block share."""

    built: WeightedSystem  # of the cameras that take part; its pixels are those of one frame
    apart: LinearSystem | None  # of the others, in the same basis, through the same gas
    active: ActiveVoxels  # the voxels that any frame of the block may light
    pixels: tuple[NDArray[np.bool_], ...]  # (height, width) each, as asked for

    def changed(self, change: Callable[[LinearSystem], LinearSystem]) -> BlockSystem:
        """Return the same equations, both kinds of them changed alike."""
        built = replace(self.built, system=change(self.built.system))
        return replace(self, built=built, apart=self.apart and change(self.apart))

    @cached_property
    def in_sight(self) -> tuple[Masks, Masks]:
        """The pixels that may see the grid, of cameras that take part and of those that do not."""
        apart = [] if self.apart is None else pixels_in_sight(self.apart)
        return pixels_in_sight(self.built.system), apart


@dataclass(frozen=True, eq=False)
class Plan:
    """What is settled for every frame of a series."""

    scan: Scan
    grid: VoxelGrid
    options: Options  # with the device settled on in place of auto
    places: tuple[int, ...]  # of the frames in the scan
    keys: tuple[int, ...]  # places of the key frames
    screened: ScreenedScan  # the mean of the key frames
    registered: Registered
    system: BlockSystem  # of the mean, over the voxels that key frames may light
    emission: NDArray[np.float32] | None  # of the mean, where gas absorbs its own light
    choice: Choice | None  # how smooth; None: another method than auto
    choices: tuple[Choice, ...]  # of the key frames
    peak: Peak
    warnings: tuple[str, ...]
    temporal: TemporalChoice | None = None

    @property
    def on_cpu(self) -> Plan:
        """The same plan with its equations on the CPU, as other processes can be sent it."""
        system = self.system.changed(lambda one: replace(one, projector=on_cpu(one.projector)))
        return replace(self, system=system)

    def at_device_of(self, rank: int) -> Plan:
        """Return the plan of one process; processes take the devices of a machine in turn."""
        device = self.options.device
        device = f"{CUDA}:{rank % device_count(device)}" if device == CUDA else device
        options = replace(self.options, device=device)
        methods = methods_of(options)
        system = self.system.changed(lambda one: at_device(one, options, methods)[0])
        return replace(self, options=options, system=system)

    @property
    def filter(self) -> TemporalFilter | None:
        """How frames are filtered in time; None where each stands for itself."""
        return None if self.temporal is None else self.temporal.filter

    def solved_with(self, block: range) -> range:
        """Return the places of the frames that a block is solved from: its own and neighbours."""
        return block if self.filter is None else with_neighbours(block, len(self.places))

    @property
    def _coverage(self) -> dict[str, Any]:
        """How the views cover the voxels that frames may light, as if all emitted alike."""
        system = self.system.built.system
        alike = np.ones(system.projector.shape[1], np.float32)
        return view_coverage(system, alike).report()

    def report(self) -> dict[str, Any]:
        """Return what was settled, as plain numbers and words for the store's attributes."""
        built, names = self.system.built, self.registered.rig.names
        gains, refinement = self.screened.gains, self.screened.refinement
        pixels, excluded = self.screened.pixels, list(self.screened.excluded)
        rule = self.registered.rule
        device = self.options.device.partition(":")[0]  # its number changes no bit
        elsewhere = {} if device == CPU else {"device": device}
        return plain(
            elsewhere
            | {
                "peak": asdict(self.peak),
                "key_frames": [self.scan.frames[place].name for place in self.keys],
                "choice": self.choice and self.choice.setting._asdict(),
                "choices": [one.setting._asdict() for one in self.choices],
                "temporal": self.temporal and self.temporal.report(),
                "basis": built.basis.report(),
                "carving": rule and {"margin": rule.margin, "votes": rule.votes},
                "active_voxels": self.system.active.size,
                "voxels": self._coverage,
                "gains": gains.report(names) if gains else None,
                "absorption": built.absorption.report() if built.absorption else None,
                "screening": pixels and pixels.report() | {"excluded": excluded},
                "findings": [one.report() for one in self.screened.findings],
                "refinement": refinement.report() if refinement else None,
                "pixel_weights": dict(built.weighting),
                "noise": {
                    name: {"read": one.read, "gain": one.gain}
                    for name, one in zip(names, self.registered.noise, strict=True)
                },
            }
        )


def system_of_block(plan: Plan, frames: Sequence[FrameImages]) -> BlockSystem:
    """Return the equations of a block: over the union of its frames' hulls, of common pixels."""
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
