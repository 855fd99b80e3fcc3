"""Stage 2, screen: the pixels and views that the reconstruction may use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel, estimate_noise
from tomo.operators.view_gains import Gains
from tomo.pipeline.load import LoadedScan
from tomo.pipeline.stage import Record, timed
from tomo.scan import Scan
from tomo.scan.images import Images, Masks
from tomo.screening import Screening, screen_images
from tomo.screening.remedies import Remedy


@dataclass(frozen=True, eq=False)
class ScreenedScan:
    """A frame's images: those that take part, and those that are only compared with.

    Attributes
    ----------
    scan : Scan
        The cameras to reconstruct from.
    images, masks : list of (height, width)
        Those of these cameras; outlier pixels are 0 and not usable.
    apart : Scan, optional
        The cameras held out and those excluded.
    apart_images, apart_masks : list of (height, width)
        Those of these cameras; outlier pixels of cameras held out are 0 and not usable.
    screening : Screening, optional
        None where nothing was screened.
    record : Record
    """

    scan: Scan
    images: Images
    masks: Masks
    apart: Scan | None
    apart_images: Images
    apart_masks: Masks
    screening: Screening | None = None
    record: Record = Record()

    @cached_property
    def noise(self) -> tuple[NoiseModel, ...]:
        """The noise of each image that takes part: that of the screening, if there was one."""
        if self.screening is None:
            both = zip(self.images, self.masks, strict=True)
            return tuple(estimate_noise(image, mask) for image, mask in both)
        known = dict(zip(self.screening.outliers, self.screening.noise, strict=True))
        for name, one in self.screening.remedies.items():
            model = known[name]
            known[name] = NoiseModel(model.read / one.gain, model.gain / one.gain)
        return tuple(known[name] for name in self.scan.rig.names)

    def gains(self, fitted: Gains | None) -> Gains | None:
        """Return the whole gains and backgrounds that the images were corrected by.

        Parameters
        ----------
        fitted : Gains, optional
            Those of the images that take part, as they are here.

        Returns
        -------
        Gains or None
            Those of the images as they were read. Standard errors are infinite where only the
            screening corrected; None where nothing was.
        """
        done = self._scaled
        if not done:
            return fitted
        names, none = self.scan.rig.names, Remedy()
        both = [done.get(name, none) for name in names]
        if fitted is None:
            unknown = np.full(len(names), np.inf)
            fitted = replace(Gains.none(len(names)), gain_error=unknown, offset_error=unknown)
        return fitted.of_images_before([one.gain for one in both], [one.level for one in both])

    @property
    def is_scaled(self) -> bool:
        """Whether the screening divided an image that takes part, or subtracted from it."""
        return bool(self._scaled)

    @property
    def _scaled(self) -> dict[str, Remedy]:
        remedies = self.screening.remedies if self.screening else {}
        used = ((name, remedies.get(name)) for name in self.scan.rig.names)
        return {name: one for name, one in used if one and (one.gain != 1 or one.level != 0)}

    @property
    def excluded(self) -> tuple[str, ...]:
        """The cameras that the others contradict."""
        return self.screening.excluded if self.screening else ()

    @property
    def not_excluded(self) -> Images:
        """The images that take part and those held out."""
        names = self.apart.rig.names if self.apart else ()
        apart = zip(names, self.apart_images, strict=True)
        return [*self.images, *(image for name, image in apart if name not in self.excluded)]

    @property
    def unmodelled_light(self) -> bool:
        """Whether images show light that no volume in the grid explains."""
        return self.screening is not None and self.screening.unmodelled_light


def screen(
    loaded: LoadedScan,
    grid: VoxelGrid,
    hold_out: Sequence[str],
    *,
    look: bool,
    move: bool = True,
    scale: bool = True,
) -> ScreenedScan:
    """Part a frame's images into those that take part and those that are only compared with.

    Parameters
    ----------
    loaded : LoadedScan
    grid : VoxelGrid
    hold_out : sequence of str
        Cameras that take no part. Their images are searched for outlier pixels, and nothing that
        is found in them changes another image.
    look : bool
        Whether to look for outlier pixels and cameras that stand out, see `tomo.screening`.
    move, scale : bool
        Whether a camera that stands out may be moved, and its image be scaled.
    """
    scan, screening = loaded.scan, None
    with timed() as stage:
        both = zip(loaded.images, loaded.masks, strict=True)
        everything = dict(zip(scan.rig.names, both, strict=True))

        def of(part: Scan | None) -> tuple[Images, Masks]:
            pairs = [everything[name] for name in part.rig.names] if part else []
            return [image for image, _ in pairs], [mask for _, mask in pairs]

        used = scan.without(*hold_out) if hold_out else scan
        apart = scan.only(*hold_out) if hold_out else None
        if look:
            held_out = (apart.rig, *of(apart)) if apart else None
            screening = screen_images(
                used.rig, *of(used), grid, held_out=held_out, move=move, scale=scale
            )
            stage.warnings += screening.warnings
            for name, mask in zip(screening.outliers, screening.masks, strict=True):
                image, usable = everything[name]
                if name not in screening.excluded and (mask != usable).any():
                    everything[name] = np.where(mask, image, 0), mask
            if screening.excluded:
                used = used.without(*screening.excluded)
                apart = scan.only(*hold_out, *screening.excluded)
            used = _remedied(used, everything, screening)
    return ScreenedScan(used, *of(used), apart, *of(apart), screening, stage.record)


def _remedied(
    used: Scan,
    everything: dict[str, tuple[NDArray[np.float32], NDArray[np.bool_]]],
    screening: Screening,
) -> Scan:
    """Return the scan with moved cameras; images are corrected in place of the others."""
    cameras = {camera.name: camera for camera in used.rig}
    for name, one in screening.remedies.items():
        if name not in cameras:
            continue
        image, mask = everything[name]
        everything[name] = np.where(mask, one.corrected(image), 0), mask
        cameras[name] = one.camera or cameras[name]
    if all(camera is cameras[camera.name] for camera in used.rig):
        return used
    return replace(used, rig=replace(used.rig, cameras=tuple(cameras.values())))
