"""Figures of a camera beyond its projection: its optics, and how exactly it is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any


def check_figures(owner: Any, name: str, is_right: Callable[[float], bool], expected: str) -> None:
    """Make the numbers of a frozen dataclass plain floats, so that values compare and hash.

    None stays; one line, ``name`` first, names the first that ``is_right`` denies and
    ``expected``.
    """
    for field in fields(owner):
        found = getattr(owner, field.name)
        if found is None:
            continue
        try:
            value = float(found)
        except (TypeError, ValueError, OverflowError):
            value = math.nan
        if not (math.isfinite(value) and is_right(value)) or isinstance(found, bool):
            raise ValueError(f"{name}.{field.name}: found {found!r}, expected {expected}")
        object.__setattr__(owner, field.name, value)


@dataclass(frozen=True)
class Optics:
    """A lens's figures; each is optional, in the rig's length unit (``f_number`` has none).

    Parameters
    ----------
    focal_length : float, optional
        The lens's nominal one; the camera matrix holds the effective one, in pixels.
    f_number : float, optional
        Focal length over the diameter of the entrance pupil.
    focus_distance : float, optional
        Distance from the centre of projection to the plane in focus.
    pixel_pitch : float, optional
        Distance of neighbouring pixels on the sensor.

    Raises
    ------
    ValueError
        If a figure is not a positive finite number.
    """

    focal_length: float | None = None
    f_number: float | None = None
    focus_distance: float | None = None
    pixel_pitch: float | None = None

    def __post_init__(self) -> None:
        """Normalise to plain floats, so that optics compare, hash and print as values."""
        check_figures(self, "optics", lambda value: value > 0, "a positive number")

    def with_lengths_scaled(self, factor: float) -> Optics:
        """Return the figures of a world whose lengths are ``factor`` times as large."""
        lengths = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "f_number"}
        return replace(self, **{name: x and x * factor for name, x in lengths.items()})

    def with_pixels_scaled(self, factor: float) -> Optics:
        """Return the figures of pixels ``factor`` times as far apart on the sensor."""
        return replace(self, pixel_pitch=self.pixel_pitch and self.pixel_pitch * factor)


@dataclass(frozen=True)
class Accuracy:
    """Standard deviations of what a camera shows of the volume, each where it is known.

    They are errors against the other cameras: a motion of the whole rig does not count. Errors of
    pose and lens cancel in an image, a turn against a shift of the centre, a longer lens against
    a larger distance, so that their own deviations would say little without all correlations.

    Parameters
    ----------
    shift : float, optional
        Of the image of the volume's middle, right and down alike, in pixels.
    roll : float, optional
        Turn of the image about that point, in degrees.
    magnification : float, optional
        Of the image about that point, a fraction of it.
    direction : float, optional
        From which the camera sees the volume, aside and above alike, in degrees.

    Raises
    ------
    ValueError
        If a number is negative or not finite.
    """

    shift: float | None = None
    roll: float | None = None
    magnification: float | None = None
    direction: float | None = None

    def __post_init__(self) -> None:
        """Normalise to plain floats, so that accuracies compare, hash and print as values."""
        check_figures(self, "accuracy", lambda value: value >= 0, "a number of at least 0")

    def with_pixels_scaled(self, factor: float) -> Accuracy:
        """Return the accuracy where pixels are ``factor`` times as far apart on the sensor."""
        return replace(self, shift=None if self.shift is None else self.shift / factor)
