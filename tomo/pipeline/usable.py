"""Images that say nothing are left out; those in a wrong place are put in their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tomo.inference.finding import Finding
from tomo.inference.fit import Fit
from tomo.inference.misplaced import find_misplaced
from tomo.inference.steps import distrust
from tomo.inference.unusable import doubles, is_dark
from tomo.pipeline.coarse import FEWEST_VIEWS, CoarseCopy
from tomo.pipeline.frames import in_place
from tomo.pipeline.screen import Place, ScreenedScan, parted
from tomo.scan import Scan

LIT = 0.05
"""Fraction of the brightest light from which a pixel is lit."""


def without_unusable(screened: ScreenedScan, whole: Scan) -> ScreenedScan:
    """Return the scan without images that say nothing, if enough others are left."""
    names, found = screened.scan.rig.names, []
    for name, image, mask, noise in zip(
        names, screened.images, screened.masks, screened.noise, strict=True
    ):
        if is_dark(image, mask, noise):
            found.append(Finding("dark", name))
    for first, second in doubles(screened.images):
        found += [
            Finding("same image", names[a], other=names[b])
            for a, b in ((first, second), (second, first))
        ]
    gone = tuple(dict.fromkeys(one.camera for one in found if one.camera))
    if not found or len(names) - len(gone) < FEWEST_VIEWS:
        return screened
    return _left_out(replace(screened, findings=tuple(found)), whole, gone)


def _left_out(screened: ScreenedScan, whole: Scan, gone: Sequence[str]) -> ScreenedScan:
    """Return the scan without some more cameras."""
    rest = replace(screened, apart=None, apart_images=[], apart_masks=[])
    kept = parted(rest, screened.scan, gone)
    if screened.apart is not None and kept.apart is not None:
        names = [*screened.apart.rig.names, *kept.apart.rig.names]
        both = dict(zip(names, [*screened.apart_images, *kept.apart_images], strict=True))
        masks = dict(zip(names, [*screened.apart_masks, *kept.apart_masks], strict=True))
        apart = whole.only(*names)
        kept = replace(
            kept,
            apart=apart,
            apart_images=[both[name] for name in apart.rig.names],
            apart_masks=[masks[name] for name in apart.rig.names],
        )
    return replace(kept, excluded=(*screened.excluded, *gone))


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
