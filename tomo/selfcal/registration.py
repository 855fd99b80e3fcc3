"""Where an image lies against a prediction of it: Gauss-Newton's method on what may move it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

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


@compiled(inline=True)
def _between(image, row, column):
    """Return the bilinear value at a place between pixels, 0 beyond the outermost centres."""
    rows, columns = image.shape
    if not (0 <= row <= rows - 1 and 0 <= column <= columns - 1):
        return 0.0
    above, left = min(int(row), max(rows - 2, 0)), min(int(column), max(columns - 2, 0))
    below, right = min(above + 1, rows - 1), min(left + 1, columns - 1)
    down, across = row - above, column - left
    upper = image[above, left] * (1 - across) + image[above, right] * across
    lower = image[below, left] * (1 - across) + image[below, right] * across
    return upper * (1 - down) + lower * down


@compiled(reassociate=True)
def _fit(predicted, image, mask, ways, amounts, moved):
    """Write the prediction moved by ``amounts`` to ``moved``; return its gain and squared error.

    The gain is the one that fits best; pixels that are not usable are 0 and count for nothing.
    """
    energy = together = 0.0
    columns = image.shape[1]
    right, down = np.zeros(columns), np.zeros(columns)
    for row in range(image.shape[0]):
        right[:] = 0.0
        down[:] = 0.0
        for way in range(len(ways)):
            for column in range(columns):
                right[column] += amounts[way] * ways[way, 0, row, column]
                down[column] += amounts[way] * ways[way, 1, row, column]
        for column in range(columns):
            value = _between(predicted, row - down[column], column - right[column])
            moved[row, column] = value if mask[row, column] else 0.0
        for column in range(columns):
            energy += moved[row, column] * moved[row, column]
            together += moved[row, column] * image[row, column]
    gain = together / energy if energy > 0 else 1.0
    error = 0.0
    for row in range(image.shape[0]):
        for column in range(columns):
            left = image[row, column] - gain * moved[row, column]
            error += left * left
    return gain, error


@compiled(inline=True)
def _slopes(moved, mask, row, down, right) -> None:
    """Write how an image changes down and right along a row, zero where it is not usable.

    By central differences, one-sided at the edges; across a single row or column it does not.
    """
    rows, columns = moved.shape
    above, below = max(row - 1, 0), min(row + 1, rows - 1)
    for column in range(columns):
        down[column] = (moved[below, column] - moved[above, column]) / max(below - above, 1)
    for column in range(1, columns - 1):
        right[column] = (moved[row, column + 1] - moved[row, column - 1]) / 2
    if columns > 1:
        right[0] = moved[row, 1] - moved[row, 0]
        right[columns - 1] = moved[row, columns - 1] - moved[row, columns - 2]
    for column in range(columns):
        if not mask[row, column]:
            down[column] = right[column] = 0.0


@compiled(reassociate=True)
def _add_changes(moved, image, mask, ways, gain, normal, towards, squares) -> None:
    """Add up how the moved prediction changes with its gain and with each way, where usable.

    Parameters
    ----------
    normal : (1 + K, 1 + K) float64
        The products of the changes, the gain's first; the lower triangle.
    towards : (1 + K,) float64
        Theirs with what is left of the image.
    squares : (1 + K, 1 + K) float64
        The sum of the squared slopes first, then the products of the ways, so weighted.
    """
    columns, count = image.shape[1], len(ways)
    down, right, left = np.zeros(columns), np.zeros(columns), np.zeros(columns)
    change = np.zeros((1 + count, columns))
    for row in range(image.shape[0]):
        _slopes(moved, mask, row, down, right)
        for column in range(columns):
            left[column] = image[row, column] - gain * moved[row, column]
            change[0, column] = moved[row, column]
        for way in range(count):
            along, across = ways[way, 0, row], ways[way, 1, row]
            for column in range(columns):
                turned = right[column] * along[column] + down[column] * across[column]
                change[1 + way, column] = -gain * turned
        for one in range(1 + count):
            total = 0.0
            for column in range(columns):
                total += change[one, column] * left[column]
            towards[one] += total
            for other in range(one + 1):
                total = 0.0
                for column in range(columns):
                    total += change[one, column] * change[other, column]
                normal[one, other] += total
        for column in range(columns):
            down[column] = down[column] * down[column] + right[column] * right[column]
            squares[0, 0] += down[column]
        for one in range(count):
            for other in range(one + 1):
                total = 0.0
                for column in range(columns):
                    total += down[column] * (
                        ways[one, 0, row, column] * ways[other, 0, row, column]
                        + ways[one, 1, row, column] * ways[other, 1, row, column]
                    )
                squares[1 + one, 1 + other] += total


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
    # kernels are compiled anew for another order in memory
    predicted = np.ascontiguousarray(predicted, np.float64)
    mask, ways = np.ascontiguousarray(mask, np.bool_), np.ascontiguousarray(ways, np.float64)
    amounts = np.zeros(len(ways))
    best = _Fit.of(predicted, image, mask, ways, amounts)
    before = best.error
    for _ in range(STEPS):
        normal, towards, _ = best.changes
        normal = normal + 1e-9 * np.trace(normal) * np.eye(len(normal))
        if not normal.any():
            break
        step = np.linalg.solve(normal, towards)[1:]
        trial = amounts + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        found = _Fit.of(predicted, image, mask, ways, trial)
        if found.error >= best.error:
            break
        amounts, best = trial, found
    return Registration(amounts, before, best.error, best.covariance(), best.changes[2])


@dataclass(frozen=True, eq=False)
class _Fit:
    """A moved prediction against the image.

    Attributes
    ----------
    image, moved : (rows, columns) float64
        Zero where they are not usable.
    mask : (rows, columns) bool
    ways : (K, 2, rows, columns) float64
    gain, error : float
        The gain that fits best, and the sum of the squared residuals with it.
    """

    image: NDArray[np.float64]
    moved: NDArray[np.float64]
    mask: NDArray[np.bool_]
    ways: NDArray[np.float64]
    gain: float
    error: float

    @classmethod
    def of(
        cls,
        predicted: NDArray[np.float64],
        image: NDArray[np.float64],
        mask: NDArray[np.bool_],
        ways: NDArray[np.float64],
        amounts: NDArray[np.float64],
    ) -> Self:
        """Return that of an image that is zero where it is not usable."""
        moved = np.zeros(image.shape)
        gain, error = _fit(predicted, image, mask, ways, amounts, moved)
        return cls(image, moved, mask, ways, gain, error)

    @cached_property
    def changes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """How the prediction changes with the gain and the amounts.

        The products of the changes ``(1 + K, 1 + K)``, theirs with the residual ``(1 + K,)``, and
        the squares ``(K, K)`` of a `Registration`.
        """
        size = 1 + len(self.ways)
        normal, squares, towards = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
        _add_changes(
            self.moved, self.image, self.mask, self.ways, self.gain, normal, towards, squares
        )
        return _whole(normal), towards, _whole(squares)[1:, 1:] / (squares[0, 0] or 1.0)

    def covariance(self) -> NDArray[np.float64]:
        """Return that of the amounts, see `Registration`."""
        normal = self.changes[0]
        size = np.sqrt(np.diag(normal))
        infinite = np.full((len(self.ways),) * 2, np.inf)
        if not (size > 0).all():
            return infinite
        normal = normal / np.outer(size, size)
        if np.linalg.matrix_rank(normal, hermitian=True) < len(normal):
            return infinite
        variance = self.error / max(np.count_nonzero(self.mask) - len(normal), 1)
        return variance * (np.linalg.inv(normal) / np.outer(size, size))[1:, 1:]


def _whole(lower: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the symmetric matrix of which only the lower triangle is given."""
    return lower + np.tril(lower, -1).T
