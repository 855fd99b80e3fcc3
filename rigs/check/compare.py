"""Comparison of two rigs: shifts, rotations and lens differences of each camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera_protocol import CameraLike, has_lens
from rigs.check.lines_of_sight import finite_rms, ray_distances
from rigs.files.text import some
from rigs.files.units import in_unit
from rigs.geometry.rotation import motion_between
from rigs.rig import Rig

_LATTICE = 25  # points along an image's longer side at which lenses are compared


@dataclass(frozen=True)
class CameraDifference:
    """The difference of one camera in two rigs, after their alignment.

    Attributes
    ----------
    distance, angle : float
        Between both positions, in the first rig's length unit, and both orientations, degrees.
    focal_length : float
        The second's focal length over the first's, less 1.
    lens : float
        RMS over the image of the distance in pixels between the images of one direction in both:
        camera matrix and distortion together. NaN where the images differ in size, or one camera
        has no lens model.
    distortion : float
        The same for the distortion alone: both seen through the first's camera matrix.
    ray_miss : float
        RMS over the volume of the distance of the camera's lines of sight from the best common
        point, see `rigs.ray_miss`; NaN without points.
    """

    name: str
    distance: float
    angle: float
    focal_length: float
    lens: float
    distortion: float
    ray_miss: float


@dataclass(frozen=True, eq=False)
class RigDifference:
    """How two rigs differ, in the first's length unit.

    Attributes
    ----------
    cameras : tuple of CameraDifference
        Those whose names both rigs have.
    only_first, only_second : tuple of str
        Names that the other rig lacks.
    R, t : (3, 3), (3,) float64
        The motion ``x_first = R x_second + t`` that aligns the second's cameras with the first's.
    turn, shift : float
        Its angle in degrees, and the distance by which it moves the middle of the cameras.
    scale : float
        Size of the first rig over that of the second; reported, not applied. NaN for one camera.
    ray_miss : float
        RMS over points and cameras; a common motion does not count. NaN without points.
    second : Rig
        The second rig after that motion.
    """

    cameras: tuple[CameraDifference, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]
    R: NDArray[np.float64]
    t: NDArray[np.float64]
    turn: float
    shift: float
    scale: float
    ray_miss: float
    second: Rig


def compare_rigs(
    first: Rig, second: Rig, points: ArrayLike | None = None, *, align: bool = True
) -> RigDifference:
    """Return how two rigs of the same cameras differ.

    Parameters
    ----------
    first, second : Rig
        Cameras are matched by name; lengths of the second are taken into the first's unit.
    points : (N, 3) array_like, optional
        Spread over the volume, in the first rig's world, for the ray-miss: the first's cameras
        project them, the second's cast rays through these pixels.
    align : bool
        Whether to align the second rig with the first before cameras are compared.

    Raises
    ------
    ValueError
        If the rigs have no camera in common, or units that cannot be converted.

    Notes
    -----
    The motion minimises the sum of squared distances between both rigs' camera positions and the
    three points one arm's length along each camera's axes (Kabsch). The arm is the cameras' RMS
    distance from their middle; the axes make the motion unique for cameras on a line, or one.
    """
    names = tuple(name for name in first.names if name in second)
    if not names:
        raise ValueError(
            f"cameras: found none in common: {some(first.names)} and {some(second.names)}"
        )
    second = in_unit(second, first.length_unit)
    one, other = ([rig[name] for name in names] for rig in (first, second))
    R, t = _motion(one, other) if align else (np.eye(3), np.zeros(3))
    moved = second.transformed(R, t)
    middle = np.mean([camera.position for camera in other], axis=0)
    miss = None
    if points is not None:
        miss = ray_distances(
            first.without(*set(first.names) - set(names)), moved, points
        )  # (C, N)
    differences = tuple(
        _difference(
            first[name], moved[name], math.nan if miss is None else finite_rms(miss[number])
        )
        for number, name in enumerate(names)
    )
    return RigDifference(
        differences,
        tuple(name for name in first.names if name not in second),
        tuple(name for name in second.names if name not in first),
        R,
        t,
        _angle(R),
        float(np.linalg.norm(R @ middle + t - middle)),
        _scale(one, other),
        math.nan if miss is None else finite_rms(miss),
        moved,
    )


def _motion(one: list[CameraLike], other: list[CameraLike]) -> tuple[NDArray, NDArray]:
    """Return R, t of ``x_one = R x_other + t``."""
    positions = [np.array([camera.position for camera in some]) for some in (one, other)]
    arm = _spread(positions[0]) or 1.0
    clouds = [
        np.concatenate(
            [position, *(position + arm * np.array([c.R[k] for c in some]) for k in range(3))]
        )
        for position, some in zip(positions, (one, other), strict=True)
    ]
    return motion_between(clouds[1], clouds[0])[:2]


def _scale(one: list[CameraLike], other: list[CameraLike]) -> float:
    """Return the ratio of both rigs' RMS distances from their middle; NaN for a single camera."""
    first, second = (_spread(np.array([c.position for c in some])) for some in (one, other))
    return first / second if first > 0 and second > 0 else math.nan


def _spread(positions: NDArray) -> float:
    """Return the RMS distance from the middle."""
    return float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _difference(one: CameraLike, other: CameraLike, miss: float) -> CameraDifference:
    focal = [math.sqrt(c.camera_matrix[0, 0] * c.camera_matrix[1, 1]) for c in (one, other)]
    lens, distortion = _lenses(one, other)
    return CameraDifference(
        one.name,
        float(np.linalg.norm(one.position - other.position)),
        _angle(one.R @ other.R.T),
        focal[1] / focal[0] - 1,
        lens,
        distortion,
        miss,
    )


def _lenses(one: CameraLike, other: CameraLike) -> tuple[float, float]:
    """Return the RMS differences over the image of whole lens and distortion, in pixels."""
    if one.image_size != other.image_size or not (has_lens(one) and has_lens(other)):
        return math.nan, math.nan
    width, height = one.image_size
    columns = np.linspace(-0.5, width - 0.5, _LATTICE)
    rows = np.linspace(-0.5, height - 0.5, max(2, round(_LATTICE * height / width)))
    uv = np.stack([axis.ravel() for axis in np.meshgrid(columns, rows)], axis=-1)
    plane = (uv - one.camera_matrix[:2, 2]) @ np.linalg.inv(one.camera_matrix[:2, :2]).T
    directions = one.distortion.unproject(plane)
    elsewhere, valid = other.distortion.project(np.nan_to_num(directions, nan=-1.0))
    valid = valid & np.isfinite(directions).all(axis=1)
    there = elsewhere @ other.camera_matrix[:2, :2].T + other.camera_matrix[:2, 2]
    alone = (elsewhere - plane) @ one.camera_matrix[:2, :2].T
    whole, distortion = (
        finite_rms(np.linalg.norm(off[valid], axis=1)) for off in (there - uv, alone)
    )
    return whole, distortion


def _angle(R: NDArray) -> float:
    """Return the angle of a rotation in degrees, accurate for small ones too."""
    sine = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return float(np.degrees(np.arctan2(sine, (np.trace(R) - 1) / 2)))
