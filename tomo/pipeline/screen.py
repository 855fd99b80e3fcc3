"""What takes part once suspect pixels and views are set aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel, estimate_noise
from tomo.scan import Scan
from tomo.scan.scan import Images, Masks
from tomo.screening import Screening, screen_images


@dataclass(frozen=True, eq=False)
class ScreenedScan:
    """A frame's images, those that take part and those that are only judged.

    Attributes
    ----------
    training : Scan
        Of the cameras to reconstruct from.
    images, masks : list of (height, width)
        Theirs; wild pixels are 0 and not usable.
    judged : Scan, optional
        Of the cameras held out and of those left out as wrong.
    judged_images, judged_masks : list of (height, width)
        Theirs; wild pixels of cameras held out are 0 and not usable.
    suspects : Screening, optional
        None where nothing was suspected on request.
    """

    training: Scan
    images: Images
    masks: Masks
    judged: Scan | None
    judged_images: Images
    judged_masks: Masks
    suspects: Screening | None = None

    @cached_property
    def noise(self) -> tuple[NoiseModel, ...]:
        """That of the images that take part: what suspects were looked for by, if they were."""
        if self.suspects is None:
            both = zip(self.images, self.masks, strict=True)
            return tuple(estimate_noise(image, mask) for image, mask in both)
        known = dict(zip(self.suspects.outliers, self.suspects.noise, strict=True))
        return tuple(known[name] for name in self.training.rig.names)

    @property
    def left_out(self) -> tuple[str, ...]:
        """The cameras that are left out as wrong."""
        return self.suspects.excluded if self.suspects else ()

    @property
    def not_left_out(self) -> Images:
        """The images that take part and those held out."""
        names = self.judged.rig.names if self.judged else ()
        judged = zip(names, self.judged_images, strict=True)
        return [*self.images, *(image for name, image in judged if name not in self.left_out)]

    @property
    def unmodelled_light(self) -> bool:
        """Whether images show light that no volume in the grid explains."""
        return self.suspects is not None and self.suspects.unmodelled_light

    @property
    def warnings(self) -> list[str]:
        """What the user should know of it."""
        return self.suspects.warnings if self.suspects else []


def screen_views(
    scan: Scan,
    images: Images,
    masks: Masks,
    grid: VoxelGrid,
    hold_out: Sequence[str],
    *,
    suspects: bool,
) -> ScreenedScan:
    """Part a frame's images into those that take part and those that are judged.

    Parameters
    ----------
    scan : Scan
    images, masks : list of (height, width)
        Of all its cameras.
    grid : VoxelGrid
    hold_out : sequence of str
        Cameras that are judged only.
    suspects : bool
        Whether to look for wild pixels and wrong views, see `tomo.suspects`.
    """
    everything = dict(zip(scan.rig.names, zip(images, masks, strict=True), strict=True))

    def of(part: Scan | None) -> tuple[Images, Masks]:
        pairs = [everything[name] for name in part.rig.names] if part else []
        return [image for image, _ in pairs], [mask for _, mask in pairs]

    training = scan.without(*hold_out) if hold_out else scan
    judged = scan.only(*hold_out) if hold_out else None
    if not suspects:
        return ScreenedScan(training, *of(training), judged, *of(judged))
    beside = (judged.rig, *of(judged)) if judged else None
    found = screen_images(training.rig, *of(training), grid, held_out=beside)
    for name, mask in zip(found.outliers, found.masks, strict=True):
        if found.outliers[name] and name not in found.excluded:
            everything[name] = np.where(mask, everything[name][0], 0), mask
    if found.excluded:
        training = training.without(*found.excluded)
        judged = scan.only(*hold_out, *found.excluded)
    return ScreenedScan(training, *of(training), judged, *of(judged), found)
