"""Whole rows and columns of an image that a sensor did not read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.measurement.bad_pixels import FRACTION, SIGMAS
from tomo.measurement.noise_model import estimate_noise

MOST_ADJACENT = 2
"""Dead lines side by side. More are a gap between two bodies, dark and clean."""

LIT = 8
"""Pixels of a line that lie beyond both of its neighbours. Fewer may be a gap between spots."""


@dataclass(frozen=True)
class DeadLines:
    """The dead rows and columns of an image, from 0.

    Attributes
    ----------
    rows, columns : tuple of int
    """

    rows: tuple[int, ...] = ()
    columns: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.rows) + len(self.columns)

    def __bool__(self) -> bool:
        """Return whether there is any."""
        return self.count > 0

    def __str__(self) -> str:
        """Return the lines in words: ``row 500`` or ``rows 3, 4, column 7``."""
        both = (("row", self.rows), ("column", self.columns))
        return ", ".join(
            f"{name}{'s' * (len(lines) > 1)} {', '.join(map(str, lines))}"
            for name, lines in both
            if lines
        )

    def pixels(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return their pixels in an image ``(height, width)``."""
        dead = np.zeros(shape, bool)
        dead[list(self.rows)] = True
        dead[:, list(self.columns)] = True
        return dead


def find_dead_lines(image: ArrayLike, mask: ArrayLike | None = None) -> DeadLines:
    """Return the rows and columns that hold one value between lines that are lit.

    Parameters
    ----------
    image : (height, width)
        As recorded, before anything is subtracted or shrunk.
    mask : (height, width) bool, optional
        True where a pixel is usable as far as is known; the others say nothing.

    Notes
    -----
    All usable pixels of a dead line have one value, to the last bit, and at `LIT` of them both
    neighbouring lines are brighter, or both are darker, by more than eight standard deviations of
    the noise and a twentieth of the image's maximum, the limits of `usable_pixels`. A dark border
    has one neighbour, a flat background none that differs, and a lens leaves no body with edges
    that are dark and bright within two pixels all along a line.
    """
    image = np.asarray(image, np.float32)
    usable = np.isfinite(image)
    if mask is not None:
        usable &= np.asarray(mask, bool)
    largest = float(np.max(image, where=usable, initial=0.0))
    if largest <= 0 or min(image.shape) < 3:
        return DeadLines()
    both = [list(_constant_runs(i, u)) for i, u in ((image, usable), (image.T, usable.T))]
    if not any(both):
        return DeadLines()
    far = np.float32(max(FRACTION * largest, SIGMAS * estimate_noise(image, usable).read))
    rows = _dead(image, usable, both[0], far)
    return DeadLines(rows, _dead(image.T, usable.T, both[1], far))


def _constant_runs(
    image: NDArray[np.float32], usable: NDArray[np.bool_]
) -> Iterator[tuple[int, int]]:
    """Yield first and last + 1 of the few adjacent rows of one value inside the image."""
    low = np.min(image, axis=1, where=usable, initial=np.inf)
    constant = low == np.max(image, axis=1, where=usable, initial=-np.inf)
    edges = np.flatnonzero(np.diff(constant, prepend=False, append=False))
    for first, stop in edges.reshape(-1, 2).tolist():
        if first > 0 and stop < len(image) and stop - first <= MOST_ADJACENT:
            yield first, stop


def _dead(
    image: NDArray[np.float32],
    usable: NDArray[np.bool_],
    runs: list[tuple[int, int]],
    far: np.float32,
) -> tuple[int, ...]:
    """Return the rows of runs that differ from the rows on both sides."""
    found: list[int] = []
    for first, stop in runs:
        sides, known = image[[first - 1, stop]], usable[[first - 1, stop]].all(axis=0)
        for row in range(first, stop):
            beyond = (image[row] < sides.min(axis=0) - far) | (
                image[row] > sides.max(axis=0) + far
            )
            if np.count_nonzero(beyond & known & usable[row]) >= LIT:
                found.append(row)
    return tuple(found)
