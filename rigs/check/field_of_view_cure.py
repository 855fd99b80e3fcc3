"""The lens, or the distance, with which a camera would see all of a volume."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigs.camera import look_at
from rigs.camera_protocol import CameraLike, LensCamera, has_lens


def how_to_see_all(camera: CameraLike, points: NDArray[np.float64], length_unit: str) -> str:
    """Return in words what would bring all points ``(N, 3)`` into a camera's image, or ``""``.

    It names the longest focal length at this place and the least distance from the points' middle
    with this lens, without the lens's distortion; aimed at the middle, where that lets a longer
    lens do. Cameras behind glass, tables of rays and fisheyes get no advice.
    """
    if not has_lens(camera) or camera.distortion.model == "fisheye":
        return ""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    aimed = camera.with_pose(camera.camera_matrix, *look_at(camera.position, middle, -camera.R[1]))
    as_it_is, factor = _longest(camera, points), _longest(aimed, points)
    aim = "aimed at the middle of the volume, "
    if _rounded_down(factor) <= _rounded_down(as_it_is):
        aimed, factor, aim = camera, as_it_is, ""
    if factor >= 1:
        return f"{aim}it would see all" if aim else ""
    if not factor > 0:
        return ""
    optics = camera.optics
    if optics is not None and optics.focal_length is not None:
        lens = f"{_rounded_down(factor * optics.focal_length):g} {length_unit}"
    else:
        focal = factor * camera.camera_matrix[0, 0]
        lens = (
            f"{_rounded_down(focal):g} pixels of focal length ({_rounded_down(factor):g} of now)"
        )
    distance = float(np.linalg.norm(camera.position - middle)) + _further(aimed, points)
    return (
        f"{aim}a lens of at most {lens}, or a distance of at least "
        f"{_rounded_up(distance):g} {length_unit}, would see all"
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


def _rounded_down(value: float) -> float:
    """Return a positive value rounded down to two digits; others are 0."""
    step = _second_digit(value)
    return math.floor(value / step) * step if value > 0 else 0.0


def _rounded_up(value: float) -> float:
    """Return a positive value rounded up to two digits."""
    step = _second_digit(value)
    return math.ceil(value / step) * step


def _second_digit(value: float) -> float:
    """Return the unit of a value's second digit."""
    return 10.0 ** (math.floor(math.log10(value)) - 1) if value > 0 else 1.0
