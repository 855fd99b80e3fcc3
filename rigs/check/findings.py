"""The rules by which a rig's figures become faults, warnings and notes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import has_lens
from rigs.check.accuracy import assumed_accuracy
from rigs.check.convention_errors import WIDEST, few_of, find_convention_errors
from rigs.check.details import details
from rigs.check.field_of_view_cure import how_to_see_all
from rigs.check.grid_choice import grid_choice
from rigs.check.result import Finding, RigCheck
from rigs.check.through_scene import gas, glass, hardware
from rigs.check.words import short
from rigs.files.units import UNITS
from rigs.geometry.points import SILENT

_LEVELS = ("fault", "warning", "note")
_AXES = "xyz"


def findings(check: RigCheck) -> tuple[Finding, ...]:
    """Return the findings of a rig's check, the worst first."""
    rules = (
        _conventions,
        _lenses,
        _sees_nothing,
        _cut_off,
        hardware,
        glass,
        gas,
        _unseen,
        details,
        _same_views,
        grid_choice,
        _blur,
        _ray_misses,
        assumed_accuracy,
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
    for error in find_convention_errors(rig, few_of(check.coverage.points), check.voxel):
        yield Finding("fault", error.text, error.cameras)
    if rig.length_unit not in UNITS:
        text = (
            f"length_unit {rig.length_unit!r} is none of {', '.join(UNITS)}: it is not converted"
        )
        yield Finding("warning", text)
    down = np.array([camera.R[1] for camera in rig])
    most = down.sum(axis=0)
    if len(rig) > 2 and np.linalg.norm(most) > 0.3 * len(rig):
        turned = tuple(
            name
            for name, direction in zip(rig.names, down @ most, strict=True)
            if direction < -0.5 * np.linalg.norm(most)
        )
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


def _sees_nothing(check: RigCheck) -> Iterator[Finding]:
    """Find cameras that see nothing of the volume, with the reason."""
    points = check.coverage.points
    middle = points.mean(axis=0)
    lower, upper = points.min(axis=0), points.max(axis=0)
    for camera, figures in zip(check.coverage.rig, check.cameras, strict=True):
        position = camera.position
        if ((position > lower) & (position < upper)).all():
            yield Finding("fault", "inside the volume", (camera.name,))
        elif figures.sees == 0:
            depth = (points @ camera.R[2] + camera.t[2] > 0).mean()
            away = middle - position
            angle = np.degrees(
                np.arccos(np.clip(camera.R[2] @ away / np.linalg.norm(away), -1, 1))
            )
            why = "turned away from it" if depth == 0 else f"aimed {angle:.0f} degrees past it"
            yield Finding("fault", f"nothing of the volume in the image: {why}", (camera.name,))


def _cut_off(check: RigCheck) -> Iterator[Finding]:
    """Find cameras whose image cuts the volume off."""
    cut = [figures for figures in check.cameras if 0 < figures.sees < 0.995]
    for figures in sorted(cut, key=lambda figures: figures.sees):
        number = check.coverage.rig.names.index(figures.name)
        where = _where(check, ~check.coverage.seen[number])
        camera = check.coverage.rig[number]
        missing = "cut off" if camera.is_straight else "cut off or hidden"
        cure = how_to_see_all(camera, check.coverage.points, check.coverage.rig.length_unit)
        yield Finding(
            "warning" if figures.sees < 0.95 else "note",
            f"{figures.sees:.0%} of the volume in the image, {missing} {where}"
            + (f": {cure}" if cure else ""),
            (figures.name,),
        )


def _unseen(check: RigCheck) -> Iterator[Finding]:
    """Find parts of the volume that no camera sees, or only one."""
    views = check.coverage.views
    for few, level, words in ((0, "fault", "no camera"), (1, "fault", "a single camera")):
        poor = views == few
        if not poor.any() or (few == 1 and len(check.coverage.rig) == 1):
            continue
        # responsible are cameras that miss this part and see only some of the volume
        sees = np.array([figures.sees for figures in check.cameras])
        missing = (~check.coverage.seen[:, poor]).mean(axis=1) > 0.5
        responsible = tuple(
            name
            for name, is_missing, fraction in zip(
                check.coverage.rig.names, missing, sees, strict=True
            )
            if is_missing and fraction < 0.995
        )
        fraction = check.fraction(poor)
        text = f"{words} sees {fraction:.1%} of the volume"
        if fraction < 0.0005:
            text = f"less than 0.1% of the volume is seen by {words}"
        yield Finding(
            level if fraction >= 0.01 else "warning",
            f"{text}, {_where(check, poor)}",
            responsible if len(responsible) < len(check.coverage.rig) else (),
        )
    if len(check.coverage.rig) == 1:
        yield Finding("fault", "a single view gives no depth: expected at least two cameras")


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
        words = ", ".join(" and ".join(pair) for pair in pairs[:4]) + (
            ", ..." if pairs[4:] else ""
        )
        distinct = len(rig) - len(pairs)
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
    responsible = tuple(
        figures.name
        for figures, value in zip(check.cameras, own, strict=True)
        if ratio > 0.5 and value > 1.5 * np.nanmedian(own)
    )
    level = "fault" if ratio > 2 else "warning" if ratio > 0.5 else "note"
    cure = ": calibrate them, or reconstruct with --refine-cameras and coarser voxels"
    yield Finding(level, text + (cure if ratio > 0.5 else ""), responsible)


def _where(check: RigCheck, poor: NDArray[np.bool_]) -> str:
    """Return in words which part of the volume ``poor`` ``(N,)`` is."""
    points = check.coverage.points
    offset = (points[poor].mean(axis=0) - points.mean(axis=0)) / check.extent
    sides = [
        f"{'+' if offset[axis] > 0 else '-'}{_AXES[axis]}"
        for axis in np.argsort(-np.abs(offset))
        if abs(offset[axis]) > 0.15
    ]
    if sides:
        return f"toward {' and '.join(sides)}"
    spread = (points[poor].std(axis=0) + 1e-300) / (points.std(axis=0) + 1e-300)
    axis = int(spread.argmax())
    return f"at both ends of {_AXES[axis]}" if spread[axis] > 1.15 else "on all sides"
