"""Stage 5, register: the voxels that dark pixels prove empty, in all frames by one rule."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull import Carving, carve
from tomo.measurement import NoiseModel
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.screen import FrameImages, ScreenedScan, noise_of_frames, usable_in_all
from tomo.pipeline.stage import Record, timed


@dataclass(frozen=True)
class HullRule:
    """How frames are carved."""

    margin: float  # pixels by which cameras may point wrongly; infinite: no voxel is empty
    votes: int

    @property
    def keeps_all(self) -> bool:
        """Whether no voxel is found empty."""
        return math.isinf(self.margin)


KEEP_ALL = HullRule(math.inf, 1)


def rule_of(found: Sequence[Carving], options: Options) -> HullRule:
    """Return the rule that suits all key frames: the largest of their own margins and votes."""
    telling = [one for one in found if not one.dark]  # no votes: views contradict each other
    if options.carving == OFF or not telling or any(one.votes == 0 for one in telling):
        return KEEP_ALL
    return HullRule(max(one.margin for one in telling), max(one.votes for one in telling))


def hull_of_frames(
    rig: Rig,
    frames: Iterable[FrameImages],
    grid: VoxelGrid,
    rule: HullRule | None,
    noise: Sequence[NoiseModel],
    otherwise: ActiveVoxels | None = None,
) -> tuple[ActiveVoxels, list[NDArray[np.bool_]]]:
    """Return the voxels that frames may light and the pixels that may see them.

    They are ``otherwise`` where all frames are dark.
    """
    active = pixels = None
    for frame in frames:
        if rule is None:
            return ActiveVoxels(grid), [np.ones_like(mask) for mask in frame.masks]
        votes = {} if rule.keeps_all else {"votes": rule.votes}
        own = carve(
            tuple(rig), frame.images, frame.masks, grid, margin=rule.margin, noise=noise, **votes
        )
        if rule.keeps_all:
            return own.active, list(own.pixels)
        if own.dark:
            continue
        mask = own.active.mask
        active = mask if active is None else active | mask
        pixels = (
            own.pixels
            if pixels is None
            else [a | b for a, b in zip(pixels, own.pixels, strict=True)]
        )
    if active is None or pixels is None:
        everything = [np.ones((c.image_size[1], c.image_size[0]), bool) for c in rig]
        return ActiveVoxels(grid) if otherwise is None else otherwise, everything
    return ActiveVoxels.from_mask(grid, active), list(pixels)


@dataclass(frozen=True, eq=False)
class Registered:
    """The rig, pixels and voxels to trace."""

    rig: Rig  # the cameras, where they were found to be
    masks: Sequence[NDArray[np.bool_]]  # (height, width) each: pixels that may take part
    active: ActiveVoxels  # the voxels that may be other than zero
    noise: tuple[NoiseModel, ...]  # that of one frame, for each camera
    carving: Carving | None = None  # of the middle frame, if it was asked for
    rule: HullRule | None = None  # how other frames are carved
    record: Record = Record()

    def report(self, pixels_used: int) -> dict[str, Any]:
        """Return ``report.json``'s ``carving``: the pixels and voxels left out, and why."""
        recorded = sum(math.prod(camera.image_size) for camera in self.rig)
        counts = {"pixels_recorded": recorded, "pixels_used": pixels_used}
        return (
            counts if self.carving is None else {**counts, **self.carving.report(self.rig.names)}
        )


def register(
    screened: ScreenedScan,
    frames: Sequence[FrameImages],
    grid: VoxelGrid,
    options: Options,
) -> Registered:
    """Carve the volume from images: voxels that any frame may light, pixels usable in all."""
    rig = screened.scan.rig
    noise = screened.noise if len(frames) == 1 else noise_of_frames(frames)
    masks, active, rule, carving = screened.masks, ActiveVoxels(grid), None, None
    with timed() as stage:
        if options.skip:
            margin = math.inf if options.carving == OFF else options.carving
            found = [
                carve(tuple(rig), one.images, one.masks, grid, margin=margin, noise=noise)
                for one in frames
            ]
            carving = found[len(found) // 2]
            stage.warnings += carving.warnings
            rule, active, seen = rule_of(found, options), carving.active, list(carving.pixels)
            if len(frames) > 1:
                active, seen = hull_of_frames(rig, frames, grid, rule, noise)
            masks = usable_in_all([seen, masks])
    return Registered(rig, masks, active, noise, carving, rule, stage.record)
