"""Stage 2, screen: the pixels that can be used, the cameras that take part, frames by both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.inference.finding import Finding
from tomo.inference.fit import Fit
from tomo.inference.misplaced import TURNS, doubles, find_misplaced, is_dark, owner
from tomo.inference.steps import distrust
from tomo.measurement import NoiseModel, estimate_noise
from tomo.measurement.pixel_check import PixelCheck, check_pixels
from tomo.model import Corrections, Observation
from tomo.operators.view_gains import Gains
from tomo.pipeline.coarse import FEWEST_VIEWS, CoarseCopy, factor_of
from tomo.pipeline.limits import Limits
from tomo.pipeline.load import LoadedScan
from tomo.pipeline.refine import Refinement
from tomo.pipeline.stage import Record, timed
from tomo.scan import Scan
from tomo.scan.images import Images, Masks


@dataclass(frozen=True)
class Place:
    """Where an image belongs that is turned over, or that of another camera."""

    camera: str
    other: str = ""  # the camera that it is exchanged with
    turned: str = ""  # a key of `tomo.inference.misplaced.TURNS`


@dataclass(frozen=True, eq=False)
class ScreenedScan:
    """A frame's images: those that take part, corrected, and those only compared with.

    Images and masks are ``(height, width)``; outlier pixels are 0 and not usable.
    """

    scan: Scan  # the cameras to reconstruct from, where they were found to be
    images: Images
    masks: Masks
    noise: tuple[NoiseModel, ...]
    apart: Scan | None  # the cameras held out and those excluded
    apart_images: Images
    apart_masks: Masks
    pixels: PixelCheck | None = None
    corrections: Corrections | None = None
    findings: tuple[Finding, ...] = ()
    refinement: Refinement | None = None  # None where none was asked for or moved
    gains: Gains | None = None
    excluded: tuple[str, ...] = ()  # they say nothing, or what the others contradict
    places: tuple[Place, ...] = ()  # images put in their places, one after the other
    emission: NDArray[np.float32] | None = None  # quick, of gas that absorbs its own light
    limits: Limits | None = None
    light_error: float = 0.0  # relative, of the total light, by what was found of cameras and gas
    record: Record = Record()


def screen(loaded: LoadedScan, hold_out: Sequence[str], *, look: bool) -> ScreenedScan:
    """Part a frame's images into those that take part and those that are only compared with."""
    scan, pixels = loaded.scan, None
    images, masks = list(loaded.images), list(loaded.masks)
    with timed() as stage:
        if look:
            pixels = check_pixels(scan.rig.names, images, masks)
            for view, mask in enumerate(pixels.masks):
                if (mask != masks[view]).any():
                    images[view], masks[view] = np.where(mask, images[view], 0), mask
            noise = pixels.noise
        else:
            both = zip(images, masks, strict=True)
            noise = tuple(estimate_noise(image, mask) for image, mask in both)
    whole = ScreenedScan(scan, images, masks, noise, None, [], [], pixels, record=stage.record)
    return parted(whole, scan, hold_out)


def parted(screened: ScreenedScan, whole: Scan, gone: Sequence[str]) -> ScreenedScan:
    """Return the images parted from those of some more cameras of a whole scan."""
    if not gone:
        return screened
    names = screened.scan.rig.names
    known = dict(zip(names, zip(screened.images, screened.masks, strict=True), strict=True))
    if screened.apart is not None:
        pairs = zip(screened.apart_images, screened.apart_masks, strict=True)
        known |= zip(screened.apart.rig.names, pairs, strict=True)
    noise = dict(zip(names, screened.noise, strict=True))
    used = screened.scan.without(*gone)
    apart = whole.only(*(name for name in known if name not in used.rig.names))
    return replace(
        screened,
        scan=used,
        images=[known[name][0] for name in used.rig.names],
        masks=[known[name][1] for name in used.rig.names],
        noise=tuple(noise[name] for name in used.rig.names),
        apart=apart,
        apart_images=[known[name][0] for name in apart.rig.names],
        apart_masks=[known[name][1] for name in apart.rig.names],
    )


def in_place(values: Sequence, names: Sequence[str], place: Place) -> list:
    """Return values, one a camera, with the one that was in the wrong place in its own."""
    found, view = list(values), names.index(place.camera)
    if place.turned:
        found[view] = TURNS[place.turned](found[view]).copy()
    else:
        other = names.index(place.other)
        found[view], found[other] = found[other], found[view]
    return found


LIT = 0.05
"""Fraction of the brightest light from which a pixel is lit."""


def without_unusable(screened: ScreenedScan, whole: Scan, grid: VoxelGrid) -> ScreenedScan:
    """Return the scan without images that say nothing or are others', if enough are left."""
    rig = screened.scan.rig
    names, each = rig.names, zip(screened.images, screened.masks, screened.noise, strict=True)
    dark = [name for name, one in zip(names, each, strict=True) if is_dark(*one)]
    said = [Finding("dark", name) for name in dark]
    lit = sorted(name for name in names if name not in dark)  # the rig's order changes no bit
    images, masks = tuple(screened.images), tuple(screened.masks)
    said += _same_images(Observation(rig, images, masks, screened.noise, grid).ordered(lit))
    gone = tuple(dict.fromkeys(one.camera for one in said if one.camera))
    if not said or len(names) - len(gone) < FEWEST_VIEWS:
        return screened
    found = replace(screened, findings=tuple(said), excluded=(*screened.excluded, *gone))
    return parted(found, whole, gone)


def _same_images(observation: Observation) -> Iterator[Finding]:
    """Yield the cameras that have another's image, all of them where nothing tells whose it is."""
    rig, groups = observation.rig, doubles(observation.images)
    if not groups:
        return
    levels, factor = np.zeros(len(rig)), factor_of(rig, observation.grid)
    copy = CoarseCopy.of([observation], levels, factor, carving=False)
    for views in groups:
        own = owner(copy.frames[0], views) if copy else None
        for view in views:
            if view != own:
                other = next(one for one in views if one != view) if own is None else own
                yield Finding("same image", rig.names[view], other=rig.names[other])


def with_image_in_place(
    screened: ScreenedScan, copy: CoarseCopy, first: Sequence[Fit]
) -> ScreenedScan | None:
    """Return the images with one that was turned over, or another camera's, in its place."""
    coarse, names = copy.frames[len(copy.frames) // 2], screened.scan.rig.names
    found = find_misplaced(coarse, distrust(first, LIT * coarse.brightest), copy.active)
    if found is None or len(screened.findings) >= len(names):
        return None
    camera = coarse.rig.names[found.view]
    if found.other is None:
        place = Place(camera, turned=found.turned)
        noise, said = screened.noise, [Finding("mirrored", camera, other=found.turned)]
    else:
        place = Place(camera, coarse.rig.names[found.other])
        noise = tuple(in_place(screened.noise, names, place))
        pairs = ((camera, place.other), (place.other, camera))
        said = [Finding("order", one, other=other) for one, other in pairs]
    images, masks = (in_place(one, names, place) for one in (screened.images, screened.masks))
    return replace(
        screened, images=images, masks=masks, noise=noise, places=(*screened.places, place),
        findings=(*screened.findings, *said),
    )  # fmt: skip


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
