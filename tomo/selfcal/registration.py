"""Registration of a prediction with its image, by the Gauss-Newton method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

STEPS = 6
"""Gauss-Newton steps at most. Fewer stop short of shifts of several pixels; steps beyond
convergence are not made."""

LARGEST_STEP = 2.0
"""Largest change of an amount in one step, in pixels. Larger steps leave the range in which the
prediction is linear; smaller ones do not reach large shifts."""


@dataclass(frozen=True, eq=False)
class Registration:
    """The motion that brings a prediction onto an image.

    Attributes
    ----------
    amounts : (K,) float64
        The amount of each motion, in pixels.
    before, after : float
        Sums of squared residuals without and with the motion, each with the best-fitting gain.
    covariance : (K, K) float64
        Covariance of the amounts in pixels squared, if the residuals are noise. Infinite where
        the image does not determine an amount.
    squares : (K, K) float64
        ``amounts @ squares @ amounts`` is the mean squared displacement in pixels squared,
        weighted by the squared slope of the image: edges count, even areas do not.
    """

    amounts: NDArray[np.float64]
    before: float
    after: float
    covariance: NDArray[np.float64]
    squares: NDArray[np.float64]


def shift_motions(shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the motions that shift an image: right and down, ``(2, 2, rows, columns)``.

    A motion is the displacement of each pixel, right and down, for an amount of one pixel.
    """
    one, none = np.ones(shape), np.zeros(shape)
    return np.array([[one, none], [none, one]])


def shift_and_zoom_motions(
    shape: tuple[int, int], fixed: tuple[float, float] | None = None
) -> NDArray[np.float64]:
    """Return the two shifts and a magnification, ``(3, 2, rows, columns)``.

    A magnification of one pixel moves points by one pixel that are half a diagonal away from the
    point ``fixed`` (row, column), the middle of the image by default.
    """
    rows, columns = np.indices(shape)
    middle = (shape[0] - 1) / 2, (shape[1] - 1) / 2
    corner = max(float(np.hypot(*middle)), 1.0)
    row, column = fixed or middle
    return np.concatenate(
        [shift_motions(shape), np.array([[columns - column, rows - row]]) / corner]
    )


def middle_of_edges(
    image: NDArray[np.floating], mask: NDArray[np.bool_]
) -> tuple[float, float] | None:
    """Return the row and column of the middle of an image's edges; None where it has none.

    About any other point a magnification shifts the edges too, and neither is what it seems.
    """
    values = np.where(mask, image, 0).astype(np.float64)
    axes = [axis for axis in (0, 1) if image.shape[axis] > 1]
    edges = sum((np.gradient(values, axis=axis) ** 2 for axis in axes), np.zeros(image.shape))
    total = float(edges.sum())
    if not total > 0:
        return None
    rows, columns = np.indices(image.shape)
    return float((edges * rows).sum()) / total, float((edges * columns).sum()) / total


@compiled(inline=True)
def _bilinear(image, row, column):
    """Return the image at a position between pixels; 0 beyond the outermost pixel centres."""
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
def _fit(predicted, image, mask, motions, amounts, moved):
    """Write the prediction moved by ``amounts`` to ``moved``; return gain and squared error.

    The gain is the best-fitting one. Unusable pixels are set to 0 and do not contribute.
    """
    energy = product = 0.0
    columns = image.shape[1]
    right, down = np.zeros(columns), np.zeros(columns)
    for row in range(image.shape[0]):
        right[:] = 0.0
        down[:] = 0.0
        for motion in range(len(motions)):
            for column in range(columns):
                right[column] += amounts[motion] * motions[motion, 0, row, column]
                down[column] += amounts[motion] * motions[motion, 1, row, column]
        for column in range(columns):
            value = _bilinear(predicted, row - down[column], column - right[column])
            moved[row, column] = value if mask[row, column] else 0.0
        for column in range(columns):
            energy += moved[row, column] * moved[row, column]
            product += moved[row, column] * image[row, column]
    gain = product / energy if energy > 0 else 1.0
    error = 0.0
    for row in range(image.shape[0]):
        for column in range(columns):
            residual = image[row, column] - gain * moved[row, column]
            error += residual * residual
    return gain, error


@compiled(inline=True)
def _slopes(moved, mask, row, down, right) -> None:
    """Write the slopes of an image along a row, down and right; zero where it is not usable.

    Differences are central inside and one-sided at the edges. The slope across a single row or
    column is zero.
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
def _add_normal_equations(moved, image, mask, motions, gain, normal, rhs, squares) -> None:
    """Add up the normal equations of a gain and ``K`` motions over the usable pixels.

    Parameters
    ----------
    normal : (1 + K, 1 + K) float64
        Products of the derivatives of the prediction, the gain's first. Only the lower triangle
        is written.
    rhs : (1 + K,) float64
        Products of the derivatives with the residual.
    squares : (1 + K, 1 + K) float64
        The sum of the squared slopes first, then the products of the motions weighted by it. Only
        the lower triangle is written.
    """
    columns, count = image.shape[1], len(motions)
    down, right, residual = np.zeros(columns), np.zeros(columns), np.zeros(columns)
    derivatives = np.zeros((1 + count, columns))
    for row in range(image.shape[0]):
        _slopes(moved, mask, row, down, right)
        for column in range(columns):
            residual[column] = image[row, column] - gain * moved[row, column]
            derivatives[0, column] = moved[row, column]
        for motion in range(count):
            along, across = motions[motion, 0, row], motions[motion, 1, row]
            for column in range(columns):
                derivative = right[column] * along[column] + down[column] * across[column]
                derivatives[1 + motion, column] = -gain * derivative
        for row_index in range(1 + count):
            total = 0.0
            for column in range(columns):
                total += derivatives[row_index, column] * residual[column]
            rhs[row_index] += total
            for column_index in range(row_index + 1):
                total = 0.0
                for column in range(columns):
                    total += derivatives[row_index, column] * derivatives[column_index, column]
                normal[row_index, column_index] += total
        for column in range(columns):
            down[column] = down[column] * down[column] + right[column] * right[column]
            squares[0, 0] += down[column]
        for row_index in range(count):
            for column_index in range(row_index + 1):
                total = 0.0
                for column in range(columns):
                    total += down[column] * (
                        motions[row_index, 0, row, column] * motions[column_index, 0, row, column]
                        + motions[row_index, 1, row, column]
                        * motions[column_index, 1, row, column]
                    )
                squares[1 + row_index, 1 + column_index] += total


def register(
    predicted: NDArray[np.floating],
    image: NDArray[np.floating],
    mask: NDArray[np.bool_],
    motions: NDArray[np.float64],
) -> Registration:
    """Find the motion that brings a prediction onto an image.

    A gain is fitted together with the motion, so that a brighter or darker camera is not taken
    for a displaced one.

    Parameters
    ----------
    predicted, image : (rows, columns)
    mask : (rows, columns) bool
        True where the image is compared.
    motions : (K, 2, rows, columns) float64
        See `shift_motions`.

    Returns
    -------
    Registration
    """
    image = np.where(mask, image, 0).astype(np.float64)
    # contiguous, as a kernel would be compiled again for another memory order
    predicted = np.ascontiguousarray(predicted, np.float64)
    mask, motions = np.ascontiguousarray(mask, np.bool_), np.ascontiguousarray(motions, np.float64)
    amounts = np.zeros(len(motions))
    best = _Fit.of(predicted, image, mask, motions, amounts)
    before = best.error
    for _ in range(STEPS):
        normal, rhs, _ = best.normal_equations
        normal = normal + 1e-9 * np.trace(normal) * np.eye(len(normal))
        if not normal.any():
            break
        step = np.linalg.solve(normal, rhs)[1:]
        candidate = amounts + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        found = _Fit.of(predicted, image, mask, motions, candidate)
        if found.error >= best.error:
            break
        amounts, best = candidate, found
    return Registration(amounts, before, best.error, best.covariance(), best.normal_equations[2])


@dataclass(frozen=True, eq=False)
class _Fit:
    """A moved prediction compared with the image.

    Attributes
    ----------
    image, moved : (rows, columns) float64
        Zero where they are not usable.
    mask : (rows, columns) bool
    motions : (K, 2, rows, columns) float64
    gain, error : float
        The best-fitting gain, and the sum of the squared residuals with it.
    """

    image: NDArray[np.float64]
    moved: NDArray[np.float64]
    mask: NDArray[np.bool_]
    motions: NDArray[np.float64]
    gain: float
    error: float

    @classmethod
    def of(
        cls,
        predicted: NDArray[np.floating],
        image: NDArray,
        mask: NDArray[np.bool_],
        motions: NDArray[np.float64],
        amounts: NDArray[np.float64],
    ) -> Self:
        """Compare an image, zero where it is not usable, with the prediction so moved."""
        moved = np.zeros(image.shape)
        gain, error = _fit(predicted, image, mask, motions, amounts, moved)
        return cls(image, moved, mask, motions, gain, error)

    @cached_property
    def normal_equations(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Matrix, right-hand side and ``squares`` of the Gauss-Newton step.

        The matrix ``(1 + K, 1 + K)`` and the right-hand side ``(1 + K,)`` are those of the gain
        and the amounts; for ``squares`` ``(K, K)`` see `Registration`.
        """
        size = 1 + len(self.motions)
        normal, squares, rhs = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
        _add_normal_equations(
            self.moved, self.image, self.mask, self.motions, self.gain, normal, rhs, squares
        )
        return _symmetric(normal), rhs, _symmetric(squares)[1:, 1:] / (squares[0, 0] or 1.0)

    def covariance(self) -> NDArray[np.float64]:
        """Return the covariance of the amounts, see `Registration`."""
        normal = self.normal_equations[0]
        size = np.sqrt(np.diag(normal))
        infinite = np.full((len(self.motions),) * 2, np.inf)
        if not (size > 0).all():
            return infinite
        normal = normal / np.outer(size, size)
        if np.linalg.matrix_rank(normal, hermitian=True) < len(normal):
            return infinite
        variance = self.error / max(int(np.count_nonzero(self.mask)) - len(normal), 1)
        return variance * (np.linalg.inv(normal) / np.outer(size, size))[1:, 1:]


def _symmetric(lower: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the symmetric matrix whose lower triangle is given."""
    return lower + np.tril(lower, -1).T
