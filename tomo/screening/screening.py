"""Which pixels and views of a frame are excluded, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import (
    NoiseModel,
    below_zero,
    cut_off_level,
    estimate_noise,
    find_outlier_pixels,
)
from tomo.measurement.background import background
from tomo.operators.system import VolumeNotSeenError
from tomo.screening.left_out_prediction import PredictedViews
from tomo.screening.outside_light import light_outside
from tomo.screening.remedies import Remedy, remedy
from tomo.screening.single_camera import (
    FEWEST_VIEWS,
    CameraFinding,
    cameras_that_stand_out,
)
from tomo.screening.words import advice_on, causes_in_words, report_of

NOTEWORTHY = 1e-3
"""Fraction of a view's pixels that are outliers, above which a warning names the camera."""

OUTSIDE = 0.01
"""Fraction of a view's light from outside the grid, above which a warning names the camera."""


@dataclass(frozen=True, eq=False)
class Screening:
    """Outlier pixels, inconsistent views, and light that no volume in the grid explains.

    Attributes
    ----------
    masks : tuple of (height, width) bool
        One a camera, held-out cameras last: True where a pixel is usable and no outlier.
    outliers : mapping
        Camera to its number of outlier pixels.
    usable : mapping
        Camera to its number of pixels that were usable.
    cameras : tuple of CameraFinding
        The cameras that stand out, held-out ones too.
    remedies : mapping of str to Remedy
        What is done about each of them.
    held_out : tuple of str
    noise : tuple of NoiseModel
        One a camera, held-out cameras last.
    below_zero : mapping
        Camera to how far its dark regions lie below zero, in image units; only those that do.
    outside : mapping
        Camera to the fraction of its light on lines of sight that miss the grid.
    background : mapping
        Camera to the level of its image's uniform background; only cameras that have one.
    saturated : mapping
        Camera to the level that its image was cut off at; only those that were.
    """

    masks: tuple[NDArray[np.bool_], ...]
    outliers: Mapping[str, int]
    usable: Mapping[str, int]
    cameras: tuple[CameraFinding, ...] = ()
    remedies: Mapping[str, Remedy] = field(default_factory=dict)
    held_out: tuple[str, ...] = ()
    noise: tuple[NoiseModel, ...] = ()
    below_zero: Mapping[str, float] = field(default_factory=dict)
    outside: Mapping[str, float] = field(default_factory=dict)
    background: Mapping[str, float] = field(default_factory=dict)
    saturated: Mapping[str, float] = field(default_factory=dict)

    @property
    def excluded(self) -> tuple[str, ...]:
        """The cameras that stand out so far that they take no part."""
        return tuple(name for name, one in self.remedies.items() if one.excluded)

    @property
    def warnings(self) -> list[str]:
        """One line for each finding that the user should act on."""
        return [
            *self._camera_warnings(),
            *self._saturation_warnings(),
            *self._background_warnings(),
            *self._outside_warnings(),
            *self._outlier_warnings(),
            *self._below_zero_warnings(),
        ]

    @property
    def above_dark(self) -> dict[str, float]:
        """Camera to how far its dark regions lie above zero, in image units; only those that do.

        The image's own level comes first. A camera that only the others contradict is compared
        with what they show, their common background included.
        """
        others = [self.background.get(name, 0.0) for name in self.outliers]
        common = float(np.median(others)) if others else 0.0
        found = {
            one.name: common + one.causes[0].parameters["level"]
            for one in self.cameras
            if one.names("background")
        }
        return {**found, **self.background}

    @property
    def unmodelled_light(self) -> bool:
        """Whether a warning reports light that no volume in the grid explains."""
        return bool(self._background_warnings() or self._outside_warnings())

    def _background_warnings(self) -> list[str]:
        own = {found.name for found in self.cameras if found.names("background")}
        levels = {name: level for name, level in self.background.items() if name not in own}
        if not levels:
            return []
        worst = max(levels, key=levels.__getitem__)
        return [
            f"{len(levels)} of {len(self.outliers)} cameras' images have a uniform "
            f"background, camera {worst} the highest ({levels[worst]:.3g}). The volume "
            "has to explain it, and gains and cameras may seem wrong. Subtract it, see the line "
            "on the dark level"
        ]

    def _outside_warnings(self) -> list[str]:
        fractions = {n: share for n, share in self.outside.items() if n not in self.background}
        worst = max(fractions, key=fractions.__getitem__, default=None)
        if worst is None or fractions[worst] <= OUTSIDE:
            return []
        return [
            f"{fractions[worst]:.0%} of camera {worst}'s light comes from outside the grid. The "
            "voxels inside have to explain it, and gains and cameras may seem wrong. Enlarge the "
            "grid, or subtract the background of the images"
        ]

    def _camera_warnings(self) -> list[str]:
        lines = []
        for found in self.cameras:
            done = self.remedies[found.name].words
            done = "It stays held out" if found.name in self.held_out else done
            steps = [step for step in (done, advice_on(found)) if step]
            lines.append(". ".join([causes_in_words(found), *steps]))
        return lines

    def _saturation_warnings(self) -> list[str]:
        return [
            f"camera {name}: its image is cut off at {level:.3g}, saturation: more pixels have "
            "that value than lie just below it. They are left out. Expose it shorter, or give the "
            "level in scan.yaml: corrections: saturation"
            for name, level in self.saturated.items()
        ]

    def _outlier_warnings(self) -> list[str]:
        fractions = {name: n / max(self.usable[name], 1) for name, n in self.outliers.items()}
        worst = max(fractions, key=fractions.__getitem__, default=None)
        if worst is None or fractions[worst] <= NOTEWORTHY:
            return []
        total = sum(self.outliers.values()) / max(sum(self.usable.values()), 1)
        return [
            f"{total:.2%} of the pixels are outliers, camera {worst} has most "
            f"({fractions[worst]:.2%}): excluded. Mask what is not single pixels (scan.yaml, "
            "corrections: mask)"
        ]

    def _below_zero_warnings(self) -> list[str]:
        if not self.below_zero:
            return []
        worst = max(self.below_zero, key=self.below_zero.__getitem__)
        return [
            f"dark regions of {len(self.below_zero)} of {len(self.outliers)} cameras' images lie "
            f"below zero, camera {worst}'s most (by {self.below_zero[worst]:.3g}). Too much was "
            "subtracted as dark, and the volume is too faint. Check the dark frames, or lower the "
            "dark level in scan.yaml (corrections: dark) by that much"
        ]

    def report(self) -> dict[str, Any]:
        """Return plain numbers and words for report.json.

        ``excluded`` lists the excluded cameras; ``outlier_pixels`` counts them for each camera;
        ``below_zero``, ``background`` and ``saturated`` hold levels, in image units, of the
        cameras concerned;
        ``light_outside_grid`` is a fraction for each camera; ``cameras`` has those that stand out
        from the others: the relative ``residual`` of its image when the others predict it, that
        of ``others``, the ratio of the two, by how much the others' squared error falls
        ``without`` the camera, its ``causes``, the likeliest first, with what each would leave of
        the squared residual, its parameters and what to do, what was ``done``, and the
        ``gain`` and ``background`` that its image was rid of.
        """
        return {
            "excluded": list(self.excluded),
            "outlier_pixels": dict(self.outliers),
            "below_zero": dict(self.below_zero),
            "background": dict(self.background),
            "saturated": dict(self.saturated),
            "light_outside_grid": dict(self.outside),
            "cameras": {
                found.name: {
                    **report_of(found),
                    "done": self.remedies[found.name].words or None,
                    "gain": self.remedies[found.name].gain,
                    "background": self.remedies[found.name].level,
                }
                for found in self.cameras
            },
        }


def screen_images(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    *,
    held_out: tuple[Rig, Sequence[NDArray], Sequence[NDArray]] | None = None,
    move: bool = True,
    scale: bool = True,
) -> Screening:
    """Find outlier pixels and cameras that stand out from the images alone.

    Parameters
    ----------
    rig, images, masks, grid
        The cameras to reconstruct from; see `tomo.selfcal.shifts.align_views`.
    held_out : (Rig, images, masks), optional
        Cameras that are tested too; nothing else depends on their images.
    move, scale : bool
        Whether cameras may be moved, and images be scaled, to agree with the others.
    """
    extra = held_out or (Rig(()), [], [])
    cameras = Rig((*rig, *extra[0]), length_unit=rig.length_unit)
    images, masks = [*images, *extra[1]], [*masks, *extra[2]]
    noise = tuple(estimate_noise(i, m) for i, m in zip(images, masks, strict=True))
    outliers = [find_outlier_pixels(i, m, n) for i, m, n in zip(images, masks, noise, strict=True)]
    clean = [m & ~o for m, o in zip(masks, outliers, strict=True)]
    tops = [cut_off_level(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    clean = [
        mask if top is None else mask & (image < top)
        for image, mask, top in zip(images, clean, tops, strict=True)
    ]
    depths = [below_zero(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    levels = [background(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    outside = light_outside(list(cameras), images, clean, noise, grid)
    findings, factor = _cameras(cameras, images, clean, levels, grid, noise, len(rig))
    remedies = {}
    for found in findings:
        if found.view >= len(rig):
            remedies[found.name] = Remedy()
            continue
        one = remedy(
            found,
            cameras[found.view],
            images[found.view],
            grid,
            factor,
            move=move,
            scale=scale,
        )
        remedies[found.name] = one
        if one.unusable is not None:
            clean[found.view] = clean[found.view] & ~one.unusable
    names = cameras.names
    return Screening(
        tuple(clean),
        {name: int(np.count_nonzero(o)) for name, o in zip(names, outliers, strict=True)},
        {name: int(np.count_nonzero(m)) for name, m in zip(names, masks, strict=True)},
        tuple(findings),
        remedies,
        tuple(extra[0].names),
        noise,
        {name: depth for name, depth in zip(names, depths, strict=True) if depth > 0},
        dict(zip(names, outside, strict=True)),
        {name: level for name, level in zip(names, levels, strict=True) if level > 0},
        {name: top for name, top in zip(names, tops, strict=True) if top is not None},
    )


def _cameras(
    cameras: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    levels: Sequence[float],
    grid: VoxelGrid,
    noise: Sequence[NoiseModel],
    trusted: int,
) -> tuple[list[CameraFinding], int]:
    """Return the cameras that stand out, and how many pixels wide their pixels are."""
    if trusted < FEWEST_VIEWS:
        return [], 1
    # No volume in the grid explains a background that most images have: all would disagree.
    common = float(np.median(levels[:trusted]))
    lit = [image - np.float32(common) if common else image for image in images]
    try:
        views = PredictedViews.of(cameras, lit, masks, grid, noise)
    except VolumeNotSeenError:  # the stage that needs the volume reports it
        return [], 1
    return cameras_that_stand_out(views, trusted), views.factor
