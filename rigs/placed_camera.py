"""A camera from what can be read off: where it stands, where it looks, its lens and its sensor."""

from __future__ import annotations

import math
from dataclasses import replace

from numpy.typing import ArrayLike

from rigs.camera import Camera, look_at, pinhole_matrix
from rigs.figures import Optics
from rigs.lens import Distortion


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
