"""The coarse copy of some frames, which quick solves share: larger pixels, larger voxels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull import carve
from tomo.inference.infer import FEWEST_VIEWS
from tomo.model import Background, Observation
from tomo.scan.downsample import coarsening

SEGMENTS = 600_000
"""Segments, about, of the coarse copy. More take longer; fewer hide what thin flames tell."""

RAYS = 2
"""Rays along each side of a pixel of that copy, where it is coarse, or so small that they cost
little: of one ray each, pixels sample thin flames unevenly, which looks like gains."""

COARSEST = 16
"""Voxels along the grid's longest edge, and pixels along an image's shortest, of that copy."""

QUARTER = 4
"""One in so many views may be dark where there is light, behind a frame: more must find a voxel
dark before it is taken for empty."""


def factor_of(rig: Rig, grid: VoxelGrid, segments: int = SEGMENTS) -> int:
    """Return how much larger the pixels and voxels of a copy of so many segments are."""
    return coarsening(rig, grid, segments, COARSEST)


@dataclass(frozen=True, eq=False)
class CoarseCopy:
    """Frames in larger pixels and voxels, less levels of the views, in units of a power of two."""

    frames: tuple[Observation, ...]  # of the same cameras, and pixels in sight of the grid
    factor: int  # pixels as recorded along one of the copy
    power: int  # the unit is 2**power: single precision holds no extremes
    levels: NDArray[np.float64]  # (views,), subtracted from each, in the images' own unit
    active: ActiveVoxels | None  # not proved empty by dark pixels in all frames; None for all

    @classmethod
    def of(
        cls,
        frames: Sequence[Observation],
        levels: NDArray[np.float64],
        factor: int,
        *,
        carving: bool,
    ) -> Self | None:
        """Return the copy of frames, those that show too little left out; None if all do."""
        single = factor_of(frames[0].rig, frames[0].grid, SEGMENTS // RAYS**2)
        rays = RAYS if factor > 1 or single == 1 else 1
        telling = [one.coarser(factor, rays) for one in frames if _lit_views(one) >= FEWEST_VIEWS]
        if not telling:
            return None
        masks = telling[0].in_sight.masks
        coarse = [
            Background().applied(replace(one, masks=masks), levels[:, None]) for one in telling
        ]
        brightest = max(one.brightest for one in coarse)
        if not brightest > 0:
            return None
        if len(coarse) > 1:
            coarse = [replace(one, light=brightest) for one in coarse]
        power = math.frexp(brightest)[1]
        coarse = [one.in_powers_of_two(power) for one in coarse]
        active = _not_dark(coarse) if carving else None
        return cls(tuple(coarse), factor, power, levels, active)

    @property
    def units(self) -> dict[str, float]:
        """Factors by which effects of the copy become those of the images, where they differ."""
        return {"pose": self.factor, "blur": self.factor**2, "background": 2.0**self.power}

    def recorded(
        self, values: Mapping[str, NDArray[np.float64]]
    ) -> dict[str, NDArray[np.float64]]:
        """Return effects found on the copy as effects of the images as they are."""
        found = {name: self.units.get(name, 1) * one for name, one in values.items()}
        if "background" in found:
            found["background"][:, 0] += self.levels / np.exp(found["gain"][:, 0])
        return found

    def enlarged(self, pixels: NDArray[np.bool_], shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return pixels of the copy as those of an image of a shape, False beyond its edge."""
        large = np.kron(pixels, np.ones((self.factor, self.factor), bool))
        found = np.zeros(np.maximum(shape, large.shape), bool)
        found[: large.shape[0], : large.shape[1]] = large
        return found[: shape[0], : shape[1]]


def _lit_views(one: Observation) -> int:
    """Return how many views show any light."""
    return sum(bool((i[m] > 0).any()) for i, m in zip(one.images, one.masks, strict=True))


def _not_dark(frames: Sequence[Observation]) -> ActiveVoxels:
    """Return the voxels that dark pixels do not prove empty in all frames."""
    votes = 1 + len(frames[0].rig) // QUARTER
    found = [
        carve(tuple(f.rig), f.images, f.masks, f.grid, votes=votes, noise=f.noise) for f in frames
    ]
    telling = [one.active for one in found if not one.dark] or [found[0].active]
    if len(telling) == 1:
        return telling[0]
    return ActiveVoxels.from_mask(frames[0].grid, np.logical_or.reduce([a.mask for a in telling]))
