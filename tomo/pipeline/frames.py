"""The images of one frame as a screening settled them: corrected, bad pixels left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.measurement import NoiseModel, estimate_noise
from tomo.model import Observation
from tomo.pipeline.load import LoadedScan
from tomo.pipeline.screen import ScreenedScan, in_place
from tomo.scan import Scan
from tomo.scan.images import Images, Masks


@dataclass(frozen=True, eq=False)
class FrameImages:
    """The images ``(height, width)`` of one frame, 0 where not usable."""

    name: str
    images: Images  # of the cameras to reconstruct from
    masks: Masks
    apart_images: Images  # of the cameras that take no part
    apart_masks: Masks
    warnings: tuple[str, ...] = ()  # what reading found, such as many pixels at full scale


def mean_of_frames(loaded: Sequence[LoadedScan]) -> LoadedScan:
    """Return the mean of frames as a frame of its own, its pixels usable in all of them.

    The mean of projections is that of the mean emission; noise is lower, wrong pixels stay wrong.
    """
    if len(loaded) == 1:
        return loaded[0]
    masks = usable_in_all([one.masks for one in loaded])
    images = [
        np.where(mask, np.mean(each, axis=0, dtype=np.float64), 0).astype(np.float32)
        for mask, each in zip(
            masks, zip(*(one.images for one in loaded), strict=True), strict=True
        )
    ]
    return LoadedScan(loaded[0].scan, loaded[0].frame, images, masks)


def images_of(loaded: LoadedScan, screened: ScreenedScan) -> FrameImages:
    """Return a frame's images as the screening of some frames settled them, corrected alike."""
    rig, images, masks = loaded.scan.rig, list(loaded.images), list(loaded.masks)
    if screened.pixels is not None:
        known = zip(masks, screened.pixels.masks, strict=True)
        masks = [mask & usable for mask, usable in known]
    for place in screened.places:
        images, masks = (in_place(each, rig.names, place) for each in (images, masks))
    if screened.corrections is not None:
        noise = (NoiseModel(0.0),) * len(rig)
        grid = screened.corrections.grid
        frame = Observation(rig, tuple(images), tuple(masks), noise, grid)
        found = screened.corrections.applied(frame, move=False)
        images, masks = list(found.images), list(found.masks)
    everything = dict(zip(rig.names, zip(images, masks, strict=True), strict=True))

    def part(of: Scan | None) -> tuple[Images, Masks]:
        pairs = [everything[name] for name in of.rig.names] if of else []
        return [np.where(mask, image, np.float32(0)) for image, mask in pairs], [
            m for _, m in pairs
        ]

    used, apart = part(screened.scan), part(screened.apart)
    said = tuple(line for line in loaded.record.warnings if line not in loaded.scan.notes)
    return FrameImages(loaded.frame, *used, *apart, said)


def usable_in_all(masks: Sequence[Masks]) -> list[NDArray[np.bool_]]:
    """Return the pixels that are usable in every frame, one image a camera."""
    return [np.logical_and.reduce(each) for each in zip(*masks, strict=True)]


def noise_of_frames(frames: Sequence[FrameImages]) -> tuple[NoiseModel, ...]:
    """Return the noise of one frame, for each camera: the median of what frames show."""
    found = []
    pairs = (zip(one.images, one.masks, strict=True) for one in frames)
    for each in zip(*pairs, strict=True):  # an image and a mask of every frame, by camera
        own = [estimate_noise(*both) for both in each]
        read, gain = (float(np.median([getattr(one, n) for one in own])) for n in ("read", "gain"))
        found.append(NoiseModel(read, gain))
    return tuple(found)
