"""Where an image lies against a prediction of it: Gauss-Newton's method on what may move it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

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
    rows, columns = np.indices(image.shape)

    def errors_at(amounts: NDArray) -> tuple[float, NDArray, NDArray, float]:
        right, down = np.sum(amounts[:, None, None, None] * ways, axis=0)
        at = [rows - down, columns - right]
        moved = map_coordinates(predicted, at, order=1, mode="constant") * mask
        energy = float(np.sum(moved**2))
        gain = float(np.sum(moved * image)) / energy if energy > 0 else 1.0
        residual = image - gain * moved
        return float(np.sum(residual**2)), moved, residual, gain

    amounts = np.zeros(len(ways))
    before, *state = errors_at(amounts)
    error = before
    for _ in range(STEPS):
        moved, residual, gain = state
        columns_of = _sensitivities(moved, gain, ways)[:, mask]  # (1 + K, pixels)
        normal = _products(columns_of)
        normal += 1e-9 * np.trace(normal) * np.eye(len(normal))
        if not normal.any():
            break
        step = np.linalg.solve(normal, np.sum(columns_of * residual[mask], axis=1))[1:]
        trial = amounts + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        found, *other = errors_at(trial)
        if found >= error:
            break
        error, amounts, state = found, trial, other
    moved, _, gain = state
    return Registration(
        amounts, before, error, _covariance(moved, gain, error, mask, ways),
        _squares(moved, mask, ways),
    )  # fmt: skip


def _sensitivities(
    moved: NDArray[np.float64], gain: float, ways: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how the moved prediction changes with gain and amounts: (1 + K, rows, columns)."""
    down, right = _slopes(moved)
    return np.stack([moved, *(-gain * (right * way[0] + down * way[1]) for way in ways)])


def _slopes(image: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return how an image changes down and right; across a single row or column it does not."""
    return [
        np.gradient(image, axis=axis) if length > 1 else np.zeros_like(image)
        for axis, length in enumerate(image.shape)
    ]


def _covariance(
    moved: NDArray, gain: float, error: float, mask: NDArray, ways: NDArray
) -> NDArray[np.float64]:
    columns_of = _sensitivities(moved, gain, ways)[:, mask]
    size = np.sqrt(np.sum(columns_of**2, axis=1))
    if not (size > 0).all():
        return np.full((len(ways),) * 2, np.inf)
    normal = _products(columns_of / size[:, None])
    if np.linalg.matrix_rank(normal, hermitian=True) < len(normal):
        return np.full((len(ways),) * 2, np.inf)
    variance = error / max(np.count_nonzero(mask) - len(normal), 1)
    return variance * (np.linalg.inv(normal) / np.outer(size, size))[1:, 1:]


def _squares(moved: NDArray, mask: NDArray, ways: NDArray) -> NDArray[np.float64]:
    down, right = _slopes(moved)
    edges = np.where(mask, down**2 + right**2, 0.0)
    total = float(edges.sum())
    weighted = ways * np.sqrt(edges / total if total > 0 else edges)
    return _products(weighted.reshape(len(ways), -1))


def _products(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the products (K, K) of rows (K, n), the same bits on any number of threads."""
    return np.sum(rows[:, None] * rows[None], axis=2)
