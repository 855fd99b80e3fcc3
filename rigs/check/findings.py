"""The rules by which a rig's figures become faults, warnings and notes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import compress

import numpy as np

from rigs.camera_protocol import has_lens
from rigs.check.convention_errors import WIDEST, few_of, find_convention_errors
from rigs.check.coverage import PIXEL_ACCURACY
from rigs.check.grid_choice import details, grid_choice
from rigs.check.in_view import cut_off, sees_nothing, unseen
from rigs.check.resolved_wavelength import short
from rigs.check.result import Finding, RigCheck
from rigs.check.through_scene import gas, glass, hardware
from rigs.files.text import some
from rigs.files.units import UNITS, UNKNOWN, metres
from rigs.geometry.points import SILENT

_LEVELS = ("fault", "warning", "note")
_RULER = 1e-3  # metres; the error of a position taken with a ruler

_UNMEASURED = {
    "nominal": (
        "warning",
        "nominal cameras: how exact they are is not known",
        "give --pixel-accuracy, calibrate them (calibrate-rig), or reconstruct with "
        "--refine-cameras nominal",
    ),
    "calibrated": (
        "note",
        "the calibration does not say how exact it is",
        "give --pixel-accuracy, or reconstruct with --refine-cameras all to see whether the "
        "images agree",
    ),
}
"""Level, meaning and cure for cameras of each status; virtual ones are exact."""


def findings(check: RigCheck) -> tuple[Finding, ...]:
    """Return the findings of a rig's check, the worst first."""
    rules = (
        _conventions,
        _lenses,
        sees_nothing,
        cut_off,
        hardware,
        glass,
        gas,
        unseen,
        details,
        _same_views,
        grid_choice,
        _blur,
        _ray_misses,
        _assumed_accuracy,
    )
    names: dict[tuple[str, str], dict[str, None]] = {}  # cameras with one finding share it
    for rule in rules:
        for finding in rule(check):
            responsible = names.setdefault((finding.level, finding.text), {})
            responsible.update(dict.fromkeys(finding.cameras))
    order = check.coverage.rig.names.index
    found = [
        Finding(level, text, tuple(sorted(cameras, key=order)))
        for (level, text), cameras in names.items()
    ]
    return tuple(sorted(found, key=lambda finding: _LEVELS.index(finding.level)))


def _conventions(check: RigCheck) -> Iterator[Finding]:
    """Find mixed up units and conventions, and cameras that are upside down."""
    rig = check.coverage.rig
    yield from find_convention_errors(rig, few_of(check.coverage.points), check.voxel)
    if rig.length_unit not in UNITS:
        text = (
            f"length_unit {rig.length_unit!r} is none of {', '.join(UNITS)}: it is not converted"
        )
        yield Finding("warning", text)
    down = np.array([camera.R[1] for camera in rig])
    most = down.sum(axis=0)
    if len(rig) > 2 and np.linalg.norm(most) > 0.3 * len(rig):
        turned = tuple(compress(rig.names, down @ most < -0.5 * np.linalg.norm(most)))
        if turned:
            text = "upside down relative to the other cameras; check that this is intended"
            yield Finding("warning", text, turned)


def _lenses(check: RigCheck) -> Iterator[Finding]:
    """Find camera matrices that do not fit their images."""
    for camera, figures in zip(check.coverage.rig, check.cameras, strict=True):
        if not has_lens(camera):
            continue
        size = np.array(camera.image_size)
        fx, fy = camera.camera_matrix[0, 0], camera.camera_matrix[1, 1]
        if camera.distortion.model != "fisheye" and figures.field_of_view > WIDEST:
            yield Finding(
                "fault",
                f"{figures.field_of_view:.0f} degrees across with a focal length of {fx:.4g} "
                f"pixels; it may be given in millimetres, expected pixels, or pixel_pitch in "
                "micrometres, expected the unit of focal_length",
                (camera.name,),
            )
        off = (camera.camera_matrix[:2, 2] - (size - 1) / 2) / size
        if (np.abs(off) > 0.2).all() and abs(off[0] - off[1]) < 0.1:
            cx, cy = camera.camera_matrix[:2, 2]
            yield Finding(
                "warning",
                f"principal point ({cx:.0f}, {cy:.0f}) lies far from the middle of "
                f"{size[0]} x {size[1]} pixels; the matrix may belong to another image size",
                (camera.name,),
            )
        if not 0.8 < fx / fy < 1.25:
            yield Finding(
                "warning",
                f"focal lengths {fx:.5g} and {fy:.5g} pixels differ: pixels are usually square",
                (camera.name,),
            )


def _same_views(check: RigCheck) -> Iterator[Finding]:
    """Find cameras whose lines of sight another camera has too."""
    rig = check.coverage.rig
    angles = check.coverage.angles_to_middle()
    limit = min(0.1 * 180.0 / len(rig), 2.0)
    paired = set()
    pairs = []
    for one, other in zip(*np.nonzero(np.triu(angles < limit)), strict=True):
        if one in paired or other in paired:
            continue
        paired |= {one, other}
        pairs.append((rig.names[one], rig.names[other]))
    if pairs:
        words, distinct = some(map(" and ".join, pairs)), len(rig) - len(pairs)
        yield Finding(
            "note",
            f"{words}: line integrals are the same from both ends: {len(rig)} cameras give "
            f"{distinct} different views. An odd number in a ring, or one of each pair turned by "
            "half a step, gives more",
            tuple(name for pair in pairs for name in pair[1:]),
        )


def _blur(check: RigCheck) -> Iterator[Finding]:
    """Find lenses out of focus in the volume."""
    for figures in check.cameras:
        if figures.blur_in_voxels > 1 and figures.blur_in_pixels > 1.5:
            yield Finding(
                "warning",
                f"out of focus by up to {short(figures.blur_in_pixels)} pixels "
                f"({short(figures.blur_in_voxels)} voxels) in the volume",
                (figures.name,),
            )


def _ray_misses(check: RigCheck) -> Iterator[Finding]:
    """Find lines of sight that do not meet within a voxel."""
    ratio = check.ray_miss / check.voxel
    if not ratio >= SILENT:
        return
    unit = check.coverage.rig.length_unit
    text = f"lines of sight miss each other by {check.ray_miss:.3g} {unit} ({ratio:.2g} voxels)"
    text += f", by {check.ray_miss_from}"
    # a calibration has a figure for each camera; without one, the largest pixels err most
    own = np.array([f.ray_miss for f in check.cameras])
    own = np.array([f.footprint for f in check.cameras]) if np.isnan(own).any() else own
    worst = (own > 1.5 * np.nanmedian(own)) & (ratio > 0.5)
    responsible = tuple(compress(check.coverage.rig.names, worst))
    level = "fault" if ratio > 2 else "warning" if ratio > 0.5 else "note"
    cure = ": calibrate them, or reconstruct with --refine-cameras and coarser voxels"
    yield Finding(level, text + (cure if ratio > 0.5 else ""), responsible)


def _assumed_accuracy(check: RigCheck) -> Iterator[Finding]:
    """Say which accuracy was assumed for cameras that nobody has measured."""
    rig = check.coverage.rig
    if check.pixel_accuracy is not None or check.ray_miss_from == "calibration":
        return
    sizes = np.array([figures.footprint for figures in check.cameras])
    for status, (level, meaning, cure) in _UNMEASURED.items():
        own = np.array([camera.status == status for camera in rig])
        if not np.isfinite(sizes[own]).any():
            continue
        pixel, unit = float(np.nanmedian(sizes[own])), rig.length_unit
        text = (
            f"{meaning}; {PIXEL_ACCURACY:g} of a pixel was assumed, "
            f"{short(PIXEL_ACCURACY * pixel)} {unit} in the volume"
        )
        if unit != UNKNOWN:
            text += f"; 1 mm, as by a ruler, is {short(_RULER / metres(unit) / pixel)} pixels here"
        names = tuple(compress(rig.names, own))
        yield Finding(level, f"{text}: {cure}", () if own.all() else names)
