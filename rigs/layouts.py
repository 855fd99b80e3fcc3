"""Virtual rigs on circles around a scene, and a camera by its place, its lens and its sensor.

The world's +y points up. Angle 0 is on the +z axis, and angles grow towards +x.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera import Camera, look_at, pinhole_matrix
from rigs.figures import Optics
from rigs.lens import Distortion
from rigs.rig import Rig, Volume


def ring(
    count: int,
    step_degrees: float | None = None,
    distance: ArrayLike = 1000.0,
    *,
    image_size: tuple[int, int],
    focal_length: float | None = None,
    pixel_pitch: float | None = None,
    footprint: float | None = None,
    pitch_degrees: ArrayLike = 0.0,
    start_degrees: float = 0.0,
    center: ArrayLike = (0.0, 0.0, 0.0),
    length_unit: str = "mm",
    volume: Volume | None = None,
) -> Rig:
    """Return ``count`` cameras every ``step_degrees`` around the axis +y through ``center``.

    Parameters
    ----------
    count : int
        Cameras; they are called cam00, cam01 and so on.
    step_degrees : float, optional
        Angle between neighbours; a full circle divided by ``count`` when None.
    distance : float or sequence of float
        Distance from ``center``; one for all, or one for each camera.
    image_size : (int, int)
        Width and height in pixels.
    focal_length, pixel_pitch : float
        Figures of the lens and the sensor, in one unit.
    footprint : float
        Instead of both, a pixel's size at ``center``, the same for every camera.
    pitch_degrees : float or sequence of float
        Elevation of a camera above the level of ``center``; negative is below. One for all, or
        one for each camera.
    start_degrees : float
        Angle of the first camera.
    center : (3,) array_like
        The point that all cameras look at.
    length_unit, volume
        As in `Rig`.

    Raises
    ------
    ValueError
        If a sequence is not as long as ``count``, or the lens is given in both ways or in none.
    """
    step = 360.0 / max(count, 1) if step_degrees is None else step_degrees
    center = np.asarray(center, np.float64)
    positions = center + _circle_positions(
        count, step, distance, pitch_degrees, start_degrees
    )  # (C, 3)
    focal = _focal_lengths(positions - center, focal_length, pixel_pitch, footprint)  # (C,)
    cameras = []
    for index, position in enumerate(positions):
        R, t = look_at(position, center)
        K = pinhole_matrix(image_size, focal[index], focal[index])
        cameras.append(Camera(f"cam{index:02d}", image_size, K, R=R, t=t))
    world = "x and z level, y up, origin as given to the layout; camera 0 on the +z side"
    return Rig(tuple(cameras), length_unit, world, volume)


def arc(count: int, span_degrees: float, distance: ArrayLike = 1000.0, **options: Any) -> Rig:
    """Return ``count`` cameras evenly spaced over ``span_degrees``, centred at angle 0.

    The first and the last camera stand at the ends. ``options`` are those of `ring`.
    """
    step = span_degrees / max(count - 1, 1)
    start = -span_degrees / 2 if count > 1 else 0.0
    return ring(count, step, distance, **({"start_degrees": start} | options))


def _circle_positions(
    count: int,
    step_degrees: float,
    distance: ArrayLike,
    pitch_degrees: ArrayLike,
    start_degrees: float,
) -> NDArray[np.float64]:
    """Return the positions of the cameras of `ring` relative to its middle, ``(count, 3)``."""
    if count < 1 or count != int(count):
        raise ValueError(f"ring count: found {count}, expected a whole number >= 1")
    count = int(count)
    distances = _per_camera(distance, count, "ring distance")
    pitch = np.deg2rad(_per_camera(pitch_degrees, count, "ring pitch_degrees"))
    if not (distances > 0).all():
        raise ValueError(f"ring distance: found {distance!s}, expected positive lengths")
    if not (np.abs(pitch) < np.pi / 2 - 1e-6).all():
        raise ValueError("ring pitch_degrees: expected angles between -90 and 90")
    angle = np.deg2rad(start_degrees + step_degrees * np.arange(count))
    x, z = np.cos(pitch) * (np.sin(angle), np.cos(angle))
    return distances[:, None] * (np.stack([x, np.sin(pitch), z], axis=-1) + 0.0)  # no -0


def _focal_lengths(
    positions: NDArray[np.float64],
    focal_length: float | None,
    pixel_pitch: float | None,
    footprint: float | None,
) -> list[float]:
    """Return each camera's focal length in pixels, ``(C,)``, from `ring`'s two ways to give it."""
    some_lens = focal_length is not None or pixel_pitch is not None
    if some_lens and footprint is not None:
        raise ValueError("ring lens: expected focal_length and pixel_pitch, or footprint alone")
    if focal_length is not None and pixel_pitch is not None:
        return [focal_length / pixel_pitch] * len(positions)
    if footprint is None:
        raise ValueError("ring lens: expected focal_length and pixel_pitch, or footprint alone")
    if not footprint > 0:
        raise ValueError(f"ring footprint: found {footprint}, expected a positive length")
    return [float(np.linalg.norm(position)) / footprint for position in positions]


def _per_camera(value: ArrayLike, count: int, what: str) -> NDArray[np.float64]:
    """Return one finite number for each camera."""
    array = np.asarray(value, np.float64)
    if array.shape not in ((), (count,)) or not np.isfinite(array).all():
        raise ValueError(f"{what}: found {value!r}, expected one number or {count}")
    return np.broadcast_to(array, count)


def camera_at(
    name: str,
    position: ArrayLike,
    target: ArrayLike,
    *,
    image_size: tuple[int, int],
    focal_length: float,
    pixel_pitch: float | tuple[float, float],
    up: ArrayLike = (0, 1, 0),
    principal_point: tuple[float, float] | None = None,
    distortion: Distortion | None = None,
    optics: Optics | None = None,
    status: str = "nominal",
) -> Camera:
    """Return the camera at a position that looks at a target, by its lens and its sensor.

    The fields are those of a camera in a handwritten rig.yaml.

    Parameters
    ----------
    name : str
    position, target : (3,) array_like
        The pinhole and the point in the image's middle, in the rig's length unit. The pinhole of
        a lens that is focused at a distance lies further from the sensor than its focal length.
    image_size : (int, int)
        Width and height in pixels.
    focal_length : float
        In the unit of ``pixel_pitch``; that of the rig where the file shall say it of the lens.
    pixel_pitch : float or (float, float)
        Distance of neighbouring pixels, along a row and down a column.
    up : (3,) array_like
        Points to the top of the image.
    principal_point : (float, float), optional
        In pixels; the image's middle when None.
    distortion : Distortion, optional
        None for none.
    optics : Optics, optional
        Further figures of the lens; its focal length and its pitch are those given here where it
        has none.
    status : {"nominal", "calibrated", "virtual"}
        How the parameters are known: ``"virtual"`` for a camera that is only simulated.

    Raises
    ------
    ValueError
        Naming the camera and the field, if a value is out of range.

    Examples
    --------
    >>> camera = camera_at(
    ...     "left", (0, 0, 500), (0, 0, 0), image_size=(9, 9), focal_length=25, pixel_pitch=0.01
    ... )
    >>> camera.project([[0, 0.2, 0]])[0].round(6).tolist()
    [[4.0, 3.0]]
    """
    try:
        K = matrix_of_lens(image_size, focal_length, pixel_pitch, principal_point)
        R, t = look_at(position, target, up)
    except ValueError as error:
        raise ValueError(f"camera {name}: {error}") from None
    lens = optics_of_lens(focal_length, pixel_pitch, optics)
    return Camera(name, image_size, K, distortion or Distortion(), R, t, lens, status)


def matrix_of_lens(
    image_size: tuple[int, int],
    focal_length: float,
    pixel_pitch: float | tuple[float, float],
    principal_point: tuple[float, float] | None = None,
) -> list[list[float]]:
    """Return the camera matrix of a lens before a sensor, see `camera_at`."""
    x, y = pixel_pitch if isinstance(pixel_pitch, tuple) else (pixel_pitch, pixel_pitch)
    for name, given, lengths in (
        ("focal_length", focal_length, [focal_length]),
        ("pixel_pitch", pixel_pitch, [x, y]),
    ):
        if not all(length > 0 and math.isfinite(length) for length in lengths):
            raise ValueError(f"{name}: found {given}, expected positive lengths")
    return pinhole_matrix(image_size, focal_length / x, focal_length / y, principal_point)


def optics_of_lens(
    focal_length: float | None,
    pixel_pitch: float | tuple[float, float] | None,
    optics: Optics | None = None,
) -> Optics | None:
    """Return the figures of a lens, completed by its focal length and its pixels where square."""
    own = optics or Optics()
    if focal_length is not None and own.focal_length is None:
        own = replace(own, focal_length=focal_length)
    if isinstance(pixel_pitch, int | float) and own.pixel_pitch is None:
        own = replace(own, pixel_pitch=pixel_pitch)
    return None if own == Optics() else own
