"""What of a volume the cameras of a rig see, and the lens or distance with which one sees all."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from rigs.camera import look_at
from rigs.camera_protocol import CameraLike, LensCamera, has_lens
from rigs.check.result import Finding, RigCheck


def sees_nothing(check: RigCheck) -> Iterator[Finding]:
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


def cut_off(check: RigCheck) -> Iterator[Finding]:
    """Find cameras whose image cuts the volume off."""
    cut = [figures for figures in check.cameras if 0 < figures.sees < 0.995]
    for figures in sorted(cut, key=lambda figures: figures.sees):
        number = check.coverage.rig.names.index(figures.name)
        where = _where(check, ~check.coverage.seen[number])
        camera = check.coverage.rig[number]
        missing = "cut off" if camera.is_straight else "cut off or hidden"
        cure = _how_to_see_all(camera, check.coverage.points, check.coverage.rig.length_unit)
        yield Finding(
            "warning" if figures.sees < 0.95 else "note",
            f"{figures.sees:.0%} of the volume in the image, {missing} {where}"
            + (f": {cure}" if cure else ""),
            (figures.name,),
        )


def unseen(check: RigCheck) -> Iterator[Finding]:
    """Find parts of the volume that no camera sees, or only one."""
    views = check.coverage.views
    for few, level, words in ((0, "fault", "no camera"), (1, "fault", "a single camera")):
        poor = views == few
        if not poor.any() or (few == 1 and len(check.coverage.rig) == 1):
            continue
        # responsible are cameras that miss this part and see only some of the volume
        sees = np.array([figures.sees for figures in check.cameras])
        missing = (~check.coverage.seen[:, poor]).mean(axis=1) > 0.5
        responsible = tuple(compress(check.coverage.rig.names, missing & (sees < 0.995)))
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


def _how_to_see_all(camera: CameraLike, points: NDArray[np.float64], length_unit: str) -> str:
    """Return in words what would bring all points ``(N, 3)`` into a camera's image, or ``""``.

    The longest focal length here, and the least distance with this lens, without distortion; aimed
    at the points' middle if that helps. Cameras behind glass, tables and fisheyes get no advice.
    """
    if not has_lens(camera) or camera.distortion.model == "fisheye":
        return ""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    aimed = camera.with_pose(camera.camera_matrix, *look_at(camera.position, middle, -camera.R[1]))
    as_it_is, factor = _longest(camera, points), _longest(aimed, points)
    aim = "aimed at the middle of the volume, "
    if _two_digits(factor) <= _two_digits(as_it_is):
        aimed, factor, aim = camera, as_it_is, ""
    if factor >= 1:
        return f"{aim}it would see all" if aim else ""
    if not factor > 0:
        return ""
    optics = camera.optics
    if optics is not None and optics.focal_length is not None:
        lens = f"{_two_digits(factor * optics.focal_length):g} {length_unit}"
    else:
        focal = factor * camera.camera_matrix[0, 0]
        lens = f"{_two_digits(focal):g} pixels of focal length ({_two_digits(factor):g} of now)"
    distance = float(np.linalg.norm(camera.position - middle)) + _further(aimed, points)
    return (
        f"{aim}a lens of at most {lens}, or a distance of at least "
        f"{_two_digits(distance, math.ceil):g} {length_unit}, would see all"
    )


def _longest(camera: LensCamera, points: NDArray) -> float:
    """Return the factor on the focal length with which all points just fill the image."""
    x, y, z = (points @ camera.R.T + camera.t).T
    if not (z > 0).all():
        return 0.0
    return min(float((room * z / reach).min()) for reach, room in _sides(camera, x, y))


def _further(camera: LensCamera, points: NDArray) -> float:
    """Return how far back along its axis a camera must go for all points to be in the image."""
    x, y, z = (points @ camera.R.T + camera.t).T
    return max(0.0, *(float((reach / room - z).max()) for reach, room in _sides(camera, x, y)))


def _sides(camera: LensCamera, x: NDArray, y: NDArray) -> Iterator[tuple[NDArray, float]]:
    """Yield what points need toward each side, in pixels at depth 1, and the pixels there."""
    width, height = camera.image_size
    (fx, _, cx), (_, fy, cy) = camera.camera_matrix[:2]
    for reach, room in (
        (fx * x, width - 0.5 - cx),
        (-fx * x, cx + 0.5),
        (fy * y, height - 0.5 - cy),
        (-fy * y, cy + 0.5),
    ):
        yield np.maximum(reach, 1e-300), room


def _two_digits(value: float, rounded: Callable[[float], int] = math.floor) -> float:
    """Return a positive value rounded, down by default, to two digits; others are 0."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1) if value > 0 else 1.0
    return rounded(value / step) * step if value > 0 else 0.0


def _where(check: RigCheck, poor: NDArray[np.bool_]) -> str:
    """Return in words which part of the volume ``poor`` ``(N,)`` is."""
    points = check.coverage.points
    offset = (points[poor].mean(axis=0) - points.mean(axis=0)) / check.extent
    sides = [
        f"{'+' if offset[axis] > 0 else '-'}{'xyz'[axis]}"
        for axis in np.argsort(-np.abs(offset))
        if abs(offset[axis]) > 0.15
    ]
    if sides:
        return f"toward {' and '.join(sides)}"
    spread = (points[poor].std(axis=0) + 1e-300) / (points.std(axis=0) + 1e-300)
    axis = int(spread.argmax())
    return f"at both ends of {'xyz'[axis]}" if spread[axis] > 1.15 else "on all sides"
