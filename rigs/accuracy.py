"""How exactly a camera is known, as it matters at the volume."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rigs.figures import check_figures


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
