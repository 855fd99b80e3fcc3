"""The voxels that frames may light: the union of their hulls, all found by one rule."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull import Carving, carve
from tomo.measurement import NoiseModel
from tomo.pipeline.frames import FrameImages
from tomo.pipeline.options import OFF, Options


@dataclass(frozen=True)
class HullRule:
    """How frames are carved.

    Attributes
    ----------
    margin : float
        Pixels by which the cameras may point wrongly; infinite: no voxel is empty.
    votes : int
        Views that must find a voxel dark.
    """

    margin: float
    votes: int

    @property
    def keeps_all(self) -> bool:
        """Whether no voxel is found empty."""
        return math.isinf(self.margin)


KEEP_ALL = HullRule(math.inf, 1)


def rule_of(found: Sequence[Carving], options: Options) -> HullRule:
    """Return the rule that suits all key frames: the largest of their own margins and votes.

    No voxel is found empty where the views of any of them contradict each other, or all of them
    are dark.
    """
    telling = [one for one in found if not one.dark]
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
    """Return the voxels that any of some frames may light, and the pixels that may see them.

    Parameters
    ----------
    rig : Rig
    frames : iterable of FrameImages
    grid : VoxelGrid
    rule : HullRule, optional
        None: all pixels are kept too.
    noise : sequence of NoiseModel
        One a camera of the rig.
    otherwise : ActiveVoxels, optional
        The voxels where all frames are dark and say nothing; all when None.
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
