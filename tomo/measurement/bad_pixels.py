"""Pixels that no mask marks: non-finite, dead and hot ones, and rows and columns not read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.measurement.noise_model import NoiseModel, estimate_noise

SIGMAS = 8.0  # standard deviations beyond the brightest or darkest neighbour
FRACTION = 0.05  # fraction of the image's maximum beyond that neighbour
TIMES = 4.0  # factor to the nearest of the neighbours' values
_DOWN, _RIGHT = (-1, -1, -1, 0, 0, 1, 1, 1), (-1, 0, 1, -1, 1, -1, 0, 1)  # to the neighbours


def usable_pixels(
    image: ArrayLike, mask: ArrayLike | None = None, noise: NoiseModel | None = None
) -> NDArray[np.bool_]:
    """Return the pixels of an image that can be trusted, ``(height, width)``.

    A scan's corrections put masks and saturation into ``mask``, True where a pixel is usable as
    far as is known; this finds what remains. A single pixel is dead or hot when it is four times
    darker or brighter than all of its eight usable neighbours (below zero: darker), and more than
    eight standard deviations and a twentieth of the image's maximum beyond that: lenses spread
    what is real over more than one pixel. Pixels on the image's border are judged by the
    neighbours that they have. There is no noise when None.
    """
    image = np.asarray(image, np.float32)
    usable = np.isfinite(image)
    if mask is not None:
        usable &= np.asarray(mask, bool)
    untrusted = None if usable.all() else ~usable
    shown = image if untrusted is None else image[usable]
    largest = float(shown.max(initial=0.0))
    if largest <= 0 or min(image.shape) < 3:
        return usable
    # One neighbour rules out nearly all pixels; the other seven are read for the rest alone.
    high, low = _of_one_neighbour(image, untrusted)
    found = np.nonzero(_is_outlier(image, high, low, np.float32(FRACTION * largest)) & usable)
    if not len(found[0]):
        return usable
    high = _of_neighbours(np.where(usable, image, -np.inf), found, np.maximum)
    low = _of_neighbours(np.where(usable, image, np.inf), found, np.minimum)
    few = _is_outlier(image[found], high, low, np.float32(FRACTION * largest)) & np.isfinite(low)
    found, high, low = tuple(axis[few] for axis in found), high[few], low[few]
    noise = NoiseModel(0.0) if noise is None else noise
    sigma = np.sqrt(noise.variance(np.maximum(low, 0)))
    far = np.maximum(SIGMAS * sigma, FRACTION * largest)
    usable[found] = ~_is_outlier(image[found], high, low, far)
    return usable


def _is_outlier(
    image: NDArray[np.float32],
    high: NDArray[np.float32],
    low: NDArray[np.float32],
    far: NDArray[np.floating] | np.float32,
) -> NDArray[np.bool_]:
    """Return which pixels are so far above or below their neighbours."""
    with np.errstate(invalid="ignore"):
        # Dividing the image instead of multiplying the neighbour cannot overflow.
        hot = image / TIMES > np.abs(high) + far / TIMES
        # A quarter of a negative value is brighter, not darker.
        return hot | (image < np.minimum(low, low / TIMES) - far)


def _of_one_neighbour(
    image: NDArray[np.float32], untrusted: NDArray[np.bool_] | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return bounds of the magnitude of the highest, and of the lowest, neighbour of each pixel.

    From below and from above, by the neighbour in the next row, in the last row by that before;
    one that cannot be trusted, where there are such, bounds nothing.
    """
    other = np.concatenate([image[1:], image[-2:-1]])
    if untrusted is None:
        return np.maximum(other, 0), other
    excluded = np.concatenate([untrusted[1:], untrusted[-2:-1]])
    return (
        np.maximum(np.where(excluded, np.float32(0), other), 0),
        np.where(excluded, np.float32(np.inf), other),
    )


def _of_neighbours(
    image: NDArray[np.float32], places: tuple[NDArray[np.int64], ...], extreme: np.ufunc
) -> NDArray[np.float32]:
    """Return the extreme of the eight neighbours of pixels at (row, column), fewer on the border.

    ``places`` are the rows (N,) and columns (N,).
    """
    excluded = -np.inf if extreme is np.maximum else np.inf
    padded = np.pad(image, 1, constant_values=excluded)
    row, column = (axis[:, None] + 1 for axis in places)
    return extreme.reduce(padded[row + _DOWN, column + _RIGHT], axis=1)


MOST_ADJACENT = 2
"""Dead lines side by side. More are a gap between two bodies, dark and clean."""

LIT = 8
"""Pixels of a line that lie beyond both of its neighbours. Fewer may be a gap between spots."""


@dataclass(frozen=True)
class DeadLines:
    """The dead rows and columns of an image, from 0."""

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

    Of an image as recorded, before anything is subtracted or shrunk; pixels that ``mask`` leaves
    out say nothing. All usable pixels of a dead line have one value, to the last bit, and at `LIT`
    of them both neighbouring lines are brighter, or both are darker, by more than eight standard
    deviations of the noise and a twentieth of the image's maximum, the limits of `usable_pixels`.
    A dark border has one neighbour, a flat background none that differs, and a lens leaves no body
    with edges that are dark and bright within two pixels all along a line.
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
