"""Errors of convention and unit that a rig file can hold, and their correction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import compress

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.check.coverage import coverage
from rigs.check.lines_of_sight import field_of_view
from rigs.check.result import Finding
from rigs.geometry.points import evenly_spread
from rigs.rig import Rig

_FLIP = np.diag([1.0, -1.0, -1.0])
_LENGTHS = {
    1000.0: "metres, the grid millimetres",
    1e-3: "millimetres, the grid metres",
    100.0: "metres, the grid centimetres",
    0.01: "centimetres, the grid metres",
    10.0: "centimetres, the grid millimetres",
    0.1: "millimetres, the grid centimetres",
    25.4: "inches, the grid millimetres",
    1 / 25.4: "millimetres, the grid inches",
}
WIDEST = 150.0
"""Degrees across an image, by lenses other than fisheyes; wider ones are an error of unit."""

_POINTS = 60  # of the volume, at which units and conventions are tried
_COARSE = 8.0
"""Voxels per pixel: no rig is built with coarser ones. Ones finer than the inverse, with little of
the volume in view, are an error."""


def find_convention_errors(rig: Rig, points: ArrayLike, voxel: float) -> tuple[Finding, ...]:
    """Return the errors of convention or unit that explain why cameras see the volume badly.

    Points ``(N, 3)`` are spread over the volume; a voxel is ``voxel`` wide. A camera is suspected
    that sees less than 2 % of the volume, or with pixels larger than 8 voxels, or less than a
    quarter of it with pixels smaller than 1/8 voxel. Each known error is corrected in turn; the
    first is returned after whose correction those cameras see most of the volume with pixels of
    0.01 to 4 voxels. A world mirrored as a whole is consistent in itself: only images show it.
    """
    points = np.asarray(points, np.float64)
    fraction, size = _view_of_volume(rig, points, voxel)
    wrong = (fraction < 0.02) | (size > _COARSE) | ((fraction < 0.25) & (size < 1 / _COARSE))
    # stored rays have no pose that could be mistaken
    cameras = tuple(camera for camera in compress(rig, wrong) if camera.has_lens_model)
    if not cameras:
        return ()
    for alternatives in _corrections():
        text = _best(rig, cameras, alternatives, points, voxel)
        if text is not None:
            return (Finding("fault", text, tuple(camera.name for camera in cameras)),)
    if (size > _COARSE).all():
        text = f"pixels are {np.median(size):.3g} voxels wide at the volume, in every camera"
        return (
            Finding("fault", f"{text}: rig and grid seem to be in different units", rig.names),
        )
    return ()


def few_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return as many of the points of a volume, evenly spread, as the errors are looked for at."""
    return points[evenly_spread(len(points), _POINTS)]


def _best(
    rig: Rig, cameras: tuple[CameraLike, ...], alternatives: dict, points: NDArray, voxel: float
) -> str | None:
    """Return in words the error whose correction shows the cameras most of the volume, or None."""
    found = []
    for text, correct in alternatives.items():
        corrected = replace(rig, cameras=tuple(map(correct, cameras)))
        fraction, size = _view_of_volume(corrected, points, voxel)
        if (fraction > 0.5).mean() > 0.75 and 0.01 < np.nanmedian(size) < 4:
            found.append((-round(float(np.median(fraction)), 1), float(np.nanmedian(size)), text))
    if not found:
        return None
    _, voxels, text = min(found)
    who = "the camera sees" if len(cameras) == 1 else f"{len(cameras)} cameras see"
    return f"{text}; when corrected, {who} the volume at {voxels:.2g} voxels a pixel"


def _view_of_volume(rig: Rig, points: NDArray, voxel: float) -> tuple[NDArray, NDArray]:
    """Return each camera's visible fraction of the volume, and its median pixel size in voxels."""
    found = coverage(rig, points)
    size = np.full(len(rig), np.nan)
    some = found.seen.any(axis=1)
    if some.any():
        size[some] = np.nanmedian(found.footprint[some], axis=1) / voxel
    return found.seen.mean(axis=1), size


def _corrections() -> list[dict[str, Callable[[Camera], Camera]]]:
    """Return the errors that are looked for, each with its correction; likeliest first."""

    def opengl(camera: Camera) -> Camera:
        return replace(camera, R=_FLIP @ camera.R, t=_FLIP @ camera.t)

    def inverse(camera: Camera) -> Camera:
        return replace(camera, R=camera.R.T, t=-camera.R.T @ camera.t)

    def inverse_opengl(camera: Camera) -> Camera:
        return opengl(inverse(camera))

    def position(camera: Camera) -> Camera:
        return replace(camera, t=-camera.R @ camera.t)

    def finer_pixels(camera: Camera) -> Camera:
        if camera.distortion.model == "fisheye" or field_of_view(camera) <= WIDEST:
            return camera
        finer = np.array([[1e3, 1e3, 1], [1, 1e3, 1], [1, 1, 1]])
        return replace(camera, camera_matrix=camera.camera_matrix * finer)

    def scaled(factor: float) -> Callable[[Camera], Camera]:
        return lambda camera: replace(camera, t=camera.t * factor)

    lengths = {
        f"t seems to be in {words} (times {factor:g})": scaled(factor)
        for factor, words in _LENGTHS.items()
    }
    return [
        {"axes seem to be OpenGL's (y up, z backward), expected OpenCV's": opengl},
        {"poses seem to be camera-to-world, expected x_cam = R x_world + t": inverse},
        {"poses seem to be camera-to-world in OpenGL's axes, expected OpenCV's": inverse_opengl},
        {"t seems to be the camera's position, expected t = -R position": position},
        {
            "pixel_pitch seems to be in micrometres, expected the unit of focal_length "
            "(times 0.001)": finer_pixels
        },
        lengths,
    ]
