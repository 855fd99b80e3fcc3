"""The images of one frame as a plan takes them: corrected, its bad pixels left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.pipeline.load import LoadedScan, load
from tomo.pipeline.screen import ScreenedScan
from tomo.scan import Scan
from tomo.scan.scan import Images, Masks


@dataclass(frozen=True, eq=False)
class FrameImages:
    """The images of one frame.

    Attributes
    ----------
    name : str
        The frame's.
    images, masks : list of (height, width)
        Those of the cameras to reconstruct from; 0 where not usable.
    apart_images, apart_masks : list of (height, width)
        Those of the cameras that take no part.
    warnings : tuple of str
        What reading it found, such as many pixels at full scale.
    """

    name: str
    images: Images
    masks: Masks
    apart_images: Images
    apart_masks: Masks
    warnings: tuple[str, ...] = ()


def mean_of_frames(scan: Scan, loaded: list[LoadedScan]) -> LoadedScan:
    """Return the mean of frames as a frame of its own, its pixels usable in all of them.

    A projection is linear: the mean of the images is the image of the mean emission. Noise is
    lower in it, and what is wrong with pixels, cameras and gains in every frame stays.
    """
    masks = usable_in_all([one.masks for one in loaded])
    images = [
        np.where(mask, np.mean(each, axis=0, dtype=np.float64), 0).astype(np.float32)
        for mask, each in zip(
            masks, zip(*(one.images for one in loaded), strict=True), strict=True
        )
    ]
    return LoadedScan(scan, loaded[0].frame, images, masks)


def images_of(loaded: LoadedScan, screened: ScreenedScan) -> FrameImages:
    """Return a frame's images as the screening of other frames settled them.

    Pixels that it found bad are left out, cameras that it excluded take no part, and images that
    it corrected are corrected alike.
    """
    both = zip(loaded.images, loaded.masks, strict=True)
    everything = dict(zip(loaded.scan.rig.names, both, strict=True))
    screening = screened.screening
    if screening is not None:
        for name, known in zip(screening.outliers, screening.masks, strict=True):
            if name not in screening.excluded:
                image, mask = everything[name]
                everything[name] = image, mask & known
        for name, one in screening.remedies.items():
            if name not in screening.excluded and name not in screening.held_out:
                image, mask = everything[name]
                everything[name] = one.corrected(image), mask

    def part(of: Scan | None) -> tuple[Images, Masks]:
        pairs = [everything[name] for name in of.rig.names] if of else []
        return [np.where(mask, image, np.float32(0)) for image, mask in pairs], [
            m for _, m in pairs
        ]

    used, apart = part(screened.scan), part(screened.apart)
    said = tuple(line for line in loaded.record.warnings if line not in loaded.scan.notes)
    return FrameImages(loaded.frame, *used, *apart, said)


def reader_of(scan: Scan, screened: ScreenedScan) -> Callable[[int], FrameImages]:
    """Return what reads a frame by its place in the scan."""

    def read(place: int) -> FrameImages:
        return images_of(load(scan, scan.frames[place].name), screened)

    return read


def usable_in_all(masks: list[Masks]) -> list[NDArray[np.bool_]]:
    """Return the pixels that are usable in every frame, one image a camera."""
    return [np.logical_and.reduce(each) for each in zip(*masks, strict=True)]
