"""Stage 1, load: the images of one frame, corrected, and their usable pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rigs.recordings import image_notes
from tomo.grid import VoxelGrid
from tomo.measurement import DeadLines, StoredBits
from tomo.measurement.stored_bits import FULL
from tomo.pipeline.stage import Record, timed
from tomo.rays.ray_box import pixels_of_hardware
from tomo.scan import Scan
from tomo.scan.advice import WAYS, correction_line, place_of
from tomo.scan.images import Images, Masks

SATURATED = 0.01
"""Fraction of a camera's bright pixels at full scale, above which a warning names it. Lower: the
brightest pixels of images scaled to their maximum."""


@dataclass(frozen=True, eq=False)
class LoadedScan:
    """One frame of a scan in memory."""

    scan: Scan
    frame: str
    images: Images
    masks: Masks  # (height, width) each, True where usable
    record: Record = Record()
    dead_lines: Mapping[str, DeadLines] = field(default_factory=dict)  # in images as recorded


def load(
    scan: Scan,
    frame: str | None,
    grid: VoxelGrid | None = None,
    doubts: Sequence[str] = (),
) -> LoadedScan:
    """Read a frame's images; the first frame's when None.

    Pixels that see hardware of the rig's scene alone, and nothing of ``grid``, are not usable.
    ``doubts`` about the rig are the first warnings.
    """
    with timed() as stage:
        stage.warnings += doubts
        name = scan.frame(frame).name
        images, masks, saturated, dead, bits = scan.read_with_faults(name)
        stage.warnings += _of_saturation(saturated, scan.way)
        stage.warnings += _of_dead_lines(dead, scan.way)
        stage.warnings += _of_bits(bits, scan.way)
        stage.warnings += scan.remarks
        stage.warnings += image_notes(
            {
                camera: [image]
                for camera, image in scan.frame(name).images.items()
                if camera in scan.rig.names and isinstance(image, Path)
            }
        )
        if grid is not None and scan.rig.scene is not None:
            hidden = [pixels_of_hardware(camera, grid) for camera in scan.rig]
            stage.warnings += _of_hardware(scan.rig.names, hidden)
            masks = [usable & ~ended for usable, ended in zip(masks, hidden, strict=True)]
    return LoadedScan(scan, name, images, masks, stage.record, dead)


def _of_hardware(names: Sequence[str], hidden: Sequence[NDArray[np.bool_]]) -> list[str]:
    """Return the line on cameras of which pixels see hardware alone."""
    shares = {name: ended.mean() for name, ended in zip(names, hidden, strict=True) if ended.any()}
    if not shares:
        return []
    worst = max(shares, key=shares.__getitem__)
    return [
        f"scene: up to {shares[worst]:.1%} of an image (camera {worst}) is hardware, whose pixels "
        f"take no part; {len(shares)} of {len(names)} cameras see some. Where it should be less, "
        "check the pose of the solid"
    ]


def _of_saturation(saturated: Mapping[str, float], way: str) -> list[str]:
    """Return the line on cameras of which many bright pixels are at full scale."""
    names = [name for name, fraction in saturated.items() if fraction > SATURATED]
    if not names:
        return []
    worst = max(names, key=saturated.__getitem__)
    return [
        f"saturation: {saturated[worst]:.1%} of camera {worst}'s bright pixels are at full scale"
        + (f", and too many of {len(names) - 1} more cameras" if len(names) > 1 else "")
        + ": they were left out. Expose for a shorter time. Where a camera saturates below full "
        f"scale, {WAYS[way].ask.format(correction_line(way, 'saturation', {worst: 0.98}))}"
    ]


def _of_dead_lines(found: Mapping[str, DeadLines], way: str) -> list[str]:
    """Return a line for each camera with dead rows or columns."""
    return [
        f"camera {name}: {lines} of its image {'is' if lines.count == 1 else 'are'} dead: one "
        "value all along, beside lit pixels. The pixels are left out. Let the camera's map of bad "
        f"pixels know, or mask them ({place_of(way, 'mask')})"
        for name, lines in found.items()
    ]


def _of_bits(found: Mapping[str, StoredBits | None], way: str) -> list[str]:
    """Return a line for each number of bits that cameras store in 16 without saying so."""
    alike: dict[tuple[int, int], list[str]] = {}
    for name, one in found.items():
        if one is not None and one.bits is not None:
            alike.setdefault((one.bits, one.shift), []).append(name)
    lines = []
    for (bits, shift), names in alike.items():
        first, step = cast("StoredBits", found[names[0]]), 2**shift
        others = f" (and of {len(names) - 1} more)" if len(names) > 1 else ""
        if shift:
            what = f"hold multiples of {step} alone: {bits} bits, shifted up"
            means = f"and a count of the camera is {step} of {FULL}"
            do, name = "leave them out", "saturation"
            value: float = math.floor(1e3 * first.full_scale / FULL) / 1e3  # as a line writes it
        else:
            what = f"end at {first.largest}, which {first.pixels} pixels have: {bits} bits"
            means = f"and dark levels and the volume are in parts of {FULL}"
            do, name, value = f"leave them out and divide by {first.largest}", "bit_depth", bits
        all_fit = all(
            one is not None and one.largest <= first.full_scale and one.shift >= shift
            for one in found.values()
        )
        line = correction_line(way, name, value if all_fit else dict.fromkeys(names, value))
        lines.append(
            f"bits: 16-bit images of camera {names[0]}{others} {what}. Saturated pixels, at "
            f"{first.full_scale}, are not recognised, {means}. To {do}, "
            f"{WAYS[way].ask.format(line)}"
        )
    return lines
