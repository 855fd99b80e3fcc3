"""One camera's image beside what the others predict of it, and as a cause explains it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float64]

BLOCK = 6
"""Pixels along the side of a block of the checkerboard. Smaller blocks share the prediction's
errors, larger ones leave a half without a part of the flame."""

SIMPLER = 0.8
"""Fraction of a simpler cause's error that one with more parameters must come to: a shift, a pose,
a bent image. Causes whose errors are closer are not distinguished."""


@dataclass(frozen=True, eq=False)
class LeftOutView:
    """One camera's image, and what a volume made without it predicts.

    Attributes
    ----------
    measured, predicted : (rows, columns) float64
    mask : (rows, columns) bool
        True where a pixel is compared.
    variance : (rows, columns) float64
        Of the image's noise.
    others : mapping of str to (rows, columns)
        What the volume predicts for other cameras of the same image size.
    reproject : callable, optional
        The prediction of a camera moved by ``(5,)``: three rotations about the grid's centre in
        radians, and two shifts in pixels.
    pose_steps : (5,) float64
        Changes of these that move the image by about a pixel.
    """

    measured: Image
    predicted: Image
    mask: NDArray[np.bool_]
    variance: Image
    others: Mapping[str, Image] = field(default_factory=dict)
    reproject: Callable[[NDArray[np.float64]], Image] | None = None
    pose_steps: NDArray[np.float64] | None = None

    @property
    def halves(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """The two halves of the pixels, blocks of a checkerboard."""
        rows, columns = np.indices(self.mask.shape) // BLOCK
        even = (rows + columns) % 2 == 0
        return self.mask & even, self.mask & ~even

    def excess(self, predicted: Image, where: NDArray[np.bool_] | None = None) -> float:
        """Return the sum of squared errors of a prediction beyond noise; it may be below 0."""
        where = self.mask if where is None else where
        return float(np.sum((self.measured - predicted)[where] ** 2 - self.variance[where]))


@dataclass(frozen=True, eq=False)
class Explained:
    """A camera's image as a cause explains it.

    Attributes
    ----------
    cause : str
        One of the words of `CAUSES`.
    words : str
        The cause with its parameters, for a sentence.
    parameters : mapping of str to float
    count : int
        How many parameters were fitted.
    excess : float
        Sum of squared errors beyond noise, each half predicted by the fit to the other.
    pose : (5,) float, optional
        How the camera has to be moved, see `LeftOutView.reproject`.
    """

    cause: str
    words: str
    parameters: Mapping[str, float]
    count: int
    excess: float
    pose: tuple[float, ...] | None = None

    @property
    def penalty(self) -> float:
        """The factor on the error for parameters: 1 up to two, then `SIMPLER` must be reached."""
        steps = (self.count > 2) + (self.count > 5)
        return SIMPLER**-steps
