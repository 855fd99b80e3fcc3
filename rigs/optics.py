"""Figures of a lens beyond its projection, for depth of field and for the record."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from rigs.figures import check_figures


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
