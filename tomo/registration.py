"""Where an image lies against a prediction of it: Gauss-Newton's method on what may move it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from tomo._sums import dot

STEPS = 6
LARGEST_STEP = 2.0  # pixels


@dataclass(frozen=True, eq=False)
class Registration:
    """What takes a prediction onto an image.

    Attributes
    ----------
    amounts : (K,) float64
        Of each way to move, in pixels.
    before, after : float
        Squared errors as the prediction is, and moved; both with the gain that fits best.
    covariance : (K, K) float64
        Of the amounts, if what is left is noise; infinite where nothing moves.
    squares : (K, K) float64
        ``amounts @ squares @ amounts`` is the mean square, in pixels, by which what is seen is
        moved: edges count, not what is even.
    """

    amounts: NDArray[np.float64]
    before: float
    after: float
    covariance: NDArray[np.float64]
    squares: NDArray[np.float64]


def ways_to_shift(shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the ways to shift an image of ``shape``: right and down, ``(2, 2, rows, columns)``.

    A way is how far each pixel moves right and down, for an amount of one pixel.
    """
    one, none = np.ones(shape), np.zeros(shape)
    return np.array([[one, none], [none, one]])


def ways_to_shift_and_zoom(shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the ways to shift an image and to enlarge it, corners by a pixel: ``(3, 2, ...)``."""
    rows, columns = np.indices(shape)
    down, right = rows - (shape[0] - 1) / 2, columns - (shape[1] - 1) / 2
    corner = max(float(np.hypot(down, right).max()), 1.0)
    return np.concatenate([ways_to_shift(shape), np.array([[right, down]]) / corner])


def register(
    predicted: NDArray[np.floating],
    image: NDArray[np.floating],
    mask: NDArray[np.bool_],
    ways: NDArray[np.float64],
) -> Registration:
    """Return what takes a prediction onto an image.

    A brighter or darker camera is not one that looks elsewhere: a gain is fitted beside.

    Parameters
    ----------
    predicted, image : (rows, columns)
    mask : (rows, columns) bool
        Where the image is compared.
    ways : (K, 2, rows, columns) float64
        See `ways_to_shift`.
    """
    image = np.where(mask, image, 0).astype(np.float64)
    predicted = predicted.astype(np.float64)
    amounts = np.zeros(len(ways))
    best = _Fit.of(predicted, image, mask)
    before = best.error
    places = np.indices(image.shape, np.float64)
    for _ in range(STEPS):
        columns_of = best.sensitivities(ways)[:, mask]  # (1 + K, pixels)
        normal = _products(columns_of)
        normal += 1e-9 * np.trace(normal) * np.eye(len(normal))
        if not normal.any():
            break
        residual = best.residual[mask]
        step = np.linalg.solve(normal, [dot(column, residual) for column in columns_of])[1:]
        trial = amounts + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        right, down = sum(amount * way for amount, way in zip(trial, ways, strict=True))
        at = [places[0] - down, places[1] - right]
        moved = map_coordinates(predicted, at, order=1, mode="constant")
        found = _Fit.of(moved, image, mask)
        if found.error >= best.error:
            break
        amounts, best = trial, found
    return Registration(
        amounts, before, best.error, best.covariance(mask, ways), best.squares(mask, ways)
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """A moved prediction against the image.

    Attributes
    ----------
    moved, residual : (rows, columns) float64
    gain, error : float
        The gain that fits best, and the sum of the squared residuals with it.
    """

    moved: NDArray[np.float64]
    residual: NDArray[np.float64]
    gain: float
    error: float

    @classmethod
    def of(
        cls, moved: NDArray[np.float64], image: NDArray[np.float64], mask: NDArray[np.bool_]
    ) -> Self:
        """Return that of an image that is zero where it is not usable."""
        moved = moved * mask
        energy = dot(moved, moved)
        gain = dot(moved, image) / energy if energy > 0 else 1.0
        residual = image - gain * moved
        return cls(moved, residual, gain, dot(residual, residual))

    @cached_property
    def slopes(self) -> list[NDArray[np.float64]]:
        """How the image changes down and right; across a single row or column it does not."""
        return [
            np.gradient(self.moved, axis=axis) if length > 1 else np.zeros_like(self.moved)
            for axis, length in enumerate(self.moved.shape)
        ]

    def sensitivities(self, ways: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how the prediction changes with gain and amounts: (1 + K, rows, columns)."""
        down, right = self.slopes
        moving = (-self.gain * (right * way[0] + down * way[1]) for way in ways)
        return np.stack([self.moved, *moving])

    def covariance(
        self, mask: NDArray[np.bool_], ways: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return that of the amounts, see `Registration`."""
        columns_of = self.sensitivities(ways)[:, mask]
        normal = _products(columns_of)
        size = np.sqrt(np.diag(normal))
        if not (size > 0).all():
            return np.full((len(ways),) * 2, np.inf)
        normal /= np.outer(size, size)
        if np.linalg.matrix_rank(normal, hermitian=True) < len(normal):
            return np.full((len(ways),) * 2, np.inf)
        variance = self.error / max(np.count_nonzero(mask) - len(normal), 1)
        return variance * (np.linalg.inv(normal) / np.outer(size, size))[1:, 1:]

    def squares(self, mask: NDArray[np.bool_], ways: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean squares by which what is seen is moved, see `Registration`."""
        down, right = self.slopes
        edges = np.where(mask, down**2 + right**2, 0.0)
        total = float(edges.sum())
        weighted = ways * np.sqrt(edges / total if total > 0 else edges)
        return _products(weighted.reshape(len(ways), -1))


def _products(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the products (K, K) of rows (K, n), the same bits on any number of threads."""
    found = np.zeros((len(rows),) * 2)
    for one, row in enumerate(rows):
        for other in range(one + 1):
            found[one, other] = found[other, one] = dot(row, rows[other])
    return found
