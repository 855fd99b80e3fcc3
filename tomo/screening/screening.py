"""What of a moment's images is left out as wrong, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel, background, below_zero, estimate_noise, wild_pixels
from tomo.operators.system import VolumeNotSeenError
from tomo.screening.outside_light import light_beside
from tomo.screening.view_consistency import ViewVerdict, judge_views

NOTEWORTHY = 1e-3
"""Share of wild pixels, in a view, above which the user is told."""

BESIDE = 0.01
"""Share of a view's light beside the grid, likewise."""


@dataclass(frozen=True, eq=False)
class Suspects:
    """Wild pixels, wrong views, and light where there can be none.

    Attributes
    ----------
    masks : tuple of (height, width) bool
        Of all cameras, those held out last: True where a pixel is usable and not wild.
    wild : mapping
        Camera to its number of wild pixels.
    usable : mapping
        Camera to its number of pixels that were usable.
    views : tuple of ViewVerdict
        Of all cameras, those held out too; empty where too few views could tell.
    held_out : tuple of str
    noise : tuple of NoiseModel
        Of all cameras, those held out last.
    below_zero : mapping
        Camera to how far its dark regions lie below zero, in the images' unit; only those that do.
    beside : mapping
        Camera to the share of its light on lines of sight that miss the grid.
    background : mapping
        Camera to the level of the even background that its image lies on; only those that do.
    """

    masks: tuple[NDArray[np.bool_], ...]
    wild: Mapping[str, int]
    usable: Mapping[str, int]
    views: tuple[ViewVerdict, ...] = ()
    held_out: tuple[str, ...] = ()
    noise: tuple[NoiseModel, ...] = ()
    below_zero: Mapping[str, float] = field(default_factory=dict)
    beside: Mapping[str, float] = field(default_factory=dict)
    background: Mapping[str, float] = field(default_factory=dict)

    @property
    def left_out(self) -> tuple[str, ...]:
        """The cameras whose views are wrong and not held out."""
        return tuple(v.name for v in self.views if v.wrong and v.name not in self.held_out)

    @property
    def warnings(self) -> list[str]:
        """What the user should know of it."""
        return [
            *self._of_background(),
            *self._of_light_beside(),
            *self._of_wild_pixels(),
            *self._of_dark_regions(),
            *self._of_views(),
        ]

    @property
    def strange_light(self) -> bool:
        """Whether the user is told of light that no volume in the grid explains."""
        return bool(self._of_background() or self._of_light_beside())

    def _of_background(self) -> list[str]:
        if not self.background:
            return []
        worst = max(self.background, key=self.background.__getitem__)
        return [
            f"images of {len(self.background)} of {len(self.wild)} cameras lie on an even "
            f"background, that of camera {worst} on {self.background[worst]:.3g}: is it to be "
            "subtracted as dark? The volume has to explain it, and gains and cameras may seem "
            "wrong"
        ]

    def _of_light_beside(self) -> list[str]:
        shares = {n: share for n, share in self.beside.items() if n not in self.background}
        worst = max(shares, key=shares.__getitem__, default=None)
        if worst is None or shares[worst] <= BESIDE:
            return []
        return [
            f"{shares[worst]:.0%} of camera {worst}'s light lies beside the grid: does the "
            "emission reach beyond the grid, or is there a background in the images? What is "
            "inside has to explain what is not, and gains and cameras may seem wrong"
        ]

    def _of_views(self) -> list[str]:
        return [
            f"{view.in_words()}: "
            + ("held out all the same" if view.name in self.held_out else "left out")
            for view in self.views
            if view.wrong
        ]

    def _of_wild_pixels(self) -> list[str]:
        shares = {name: n / max(self.usable[name], 1) for name, n in self.wild.items()}
        worst = max(shares, key=shares.__getitem__, default=None)
        if worst is None or shares[worst] <= NOTEWORTHY:
            return []
        total = sum(self.wild.values()) / max(sum(self.usable.values()), 1)
        return [
            f"{total:.2%} of the pixels contradict their neighbours, most of all in camera "
            f"{worst} ({shares[worst]:.2%}): left out"
        ]

    def _of_dark_regions(self) -> list[str]:
        if not self.below_zero:
            return []
        worst = max(self.below_zero, key=self.below_zero.__getitem__)
        return [
            f"dark regions of {len(self.below_zero)} of {len(self.wild)} cameras' images lie "
            f"below zero, most in camera {worst} (by {self.below_zero[worst]:.3g}): was too much "
            "subtracted as dark? The volume is then too faint"
        ]

    def report(self) -> dict[str, Any]:
        """Return what a report says of them: plain numbers and words.

        ``left_out`` lists the cameras left out; ``wild_pixels`` counts those of each camera;
        ``below_zero`` has how far dark regions lie below zero, in the images' unit, of the cameras
        where they do; ``background`` has the even background of those that lie on one, likewise;
        ``light_beside_grid`` has the share of each camera's light on lines of sight that miss the
        grid; ``views`` has for each camera judged its ``agreement`` with what the others predict,
        whether it is ``wrong``, and what it ``looks`` like instead, if anything fits.
        """
        return {
            "left_out": list(self.left_out),
            "wild_pixels": dict(self.wild),
            "below_zero": dict(self.below_zero),
            "background": dict(self.background),
            "light_beside_grid": dict(self.beside),
            "views": {view.name: view.report() for view in self.views},
        }


def find_suspects(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    *,
    held_out: tuple[Rig, Sequence[NDArray], Sequence[NDArray]] | None = None,
) -> Suspects:
    """Find wild pixels and wrong views from the images alone.

    Parameters
    ----------
    rig, images, masks, grid
        Of the cameras to reconstruct from; see `tomo.selfcal.shifts.align_views`.
    held_out : (Rig, images, masks), optional
        Cameras that are judged, without their wild pixels; nothing else depends on their images.
    """
    beside = held_out or (Rig(()), [], [])
    cameras = Rig((*rig, *beside[0]), length_unit=rig.length_unit)
    images, masks = [*images, *beside[1]], [*masks, *beside[2]]
    noise = tuple(estimate_noise(i, m) for i, m in zip(images, masks, strict=True))
    wild = [wild_pixels(i, m, n) for i, m, n in zip(images, masks, noise, strict=True)]
    clean = tuple(m & ~w for m, w in zip(masks, wild, strict=True))
    depths = [below_zero(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    levels = [background(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    shares = light_beside(list(cameras), images, clean, noise, grid)
    # No volume in the grid gives an even background, and the attempt would make views disagree.
    lit = [i - np.float32(level) if level else i for i, level in zip(images, levels, strict=True)]
    try:
        views = judge_views(cameras, lit, clean, grid, trusted=len(rig))
    except VolumeNotSeenError:  # told, in better words, by whoever needs the volume
        views = ()
    return Suspects(
        clean,
        {name: int(np.count_nonzero(w)) for name, w in zip(cameras.names, wild, strict=True)},
        {name: int(np.count_nonzero(m)) for name, m in zip(cameras.names, masks, strict=True)},
        views,
        tuple(beside[0].names),
        noise,
        {name: depth for name, depth in zip(cameras.names, depths, strict=True) if depth > 0},
        dict(zip(cameras.names, shares, strict=True)),
        {name: level for name, level in zip(cameras.names, levels, strict=True) if level > 0},
    )
