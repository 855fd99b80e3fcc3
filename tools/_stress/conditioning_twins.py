"""The classic methods once more, in double precision on a dense matrix: what rounding changes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from _stress.conditioning_long import small_scene
from _stress.row import Row, relative_error, worst_of
from _stress.values_scene import run
from tomo.priors.differences import Gradient
from tomo.solvers.mlem import sensitivity
from tomo.solvers.sart import view_orders

ITERATIONS = 20
SETTLED = 2_000
STRENGTH = 1e-3  # of Tikhonov's penalty
RELAXATION = 0.5  # of ART and MART

Dense = NDArray[np.float64]


def twin_rows() -> Iterator[Row]:
    """Yield the rows of single against double precision."""
    seen = small_scene()
    matrix = seen.stored.to_scipy().toarray().astype(np.float64)
    measured = seen.measured.astype(np.float64)
    figures = []
    for method, twin in _TWINS.items():
        expected = twin(matrix, measured, ITERATIONS)
        found = run(method, seen.stored, seen.measured, ITERATIONS).volume.ravel()
        figures.append((method, relative_error(found, expected)))
    worst, where = worst_of(figures)
    yield Row(
        "single against double precision",
        f"{', '.join(_TWINS)}; {ITERATIONS} iterations",
        worst,
        1e-4,
        "of the volume",
        note=where,
    )
    gradient = Gradient(seen.stored.active)
    unit = np.eye(matrix.shape[1], dtype=np.float32)
    differences = np.stack([gradient.forward(column).ravel() for column in unit], axis=1)
    largest = (matrix.T @ (matrix @ np.ones(matrix.shape[1]))).max()
    penalty = np.sqrt(STRENGTH * largest) * differences.astype(np.float64)
    lowest = []
    for method, rows, settings in (
        ("nnls", matrix, {}),
        ("tikhonov", np.concatenate([matrix, penalty]), {"strength": STRENGTH}),
    ):
        target = np.concatenate([measured, np.zeros(len(rows) - len(matrix))])
        best = scipy.optimize.nnls(rows, target, maxiter=20 * matrix.shape[1])[1]
        found = run(method, seen.stored, seen.measured, SETTLED, **settings).volume.ravel()
        lowest.append((method, np.linalg.norm(rows @ found.astype(np.float64) - target) / best))
    worst, where = worst_of(lowest)
    yield Row(
        "single precision against the exact minimum over x >= 0 in double",
        "nnls, tikhonov",
        worst - 1,
        1e-5,
        "above it",
        note=where,
    )


def _sirt(matrix: Dense, measured: Dense, count: int) -> Dense:
    per_row, per_column = _damped(matrix.sum(1)), _reciprocal(matrix.sum(0))
    x = np.zeros(matrix.shape[1])
    for _ in range(count):
        x = np.maximum(x + per_column * (matrix.T @ (per_row * (measured - matrix @ x))), 0)
    return x


def _sart(matrix: Dense, measured: Dense, count: int) -> Dense:
    ptr, per_row = small_scene().stored.view_ptr, _damped(matrix.sum(1))
    x = np.zeros(matrix.shape[1])
    orders = itertools.islice(view_orders(len(ptr) - 1), count)
    for view in itertools.chain.from_iterable(orders):
        own = slice(ptr[view], ptr[view + 1])
        block, per_column = matrix[own], _reciprocal(matrix[own].sum(0))
        pixels = per_row[own] * (measured[own] - block @ x)
        x = np.maximum(x + per_column * (block.T @ pixels), 0)
    return x


def _cgls(matrix: Dense, measured: Dense, count: int) -> Dense:
    x = np.zeros(matrix.shape[1])
    residual = measured.copy()
    gradient = direction = matrix.T @ residual
    for _ in range(count):
        image = matrix @ direction
        step = (gradient @ gradient) / (image @ image)
        x, residual = x + step * direction, residual - step * image
        following = matrix.T @ residual
        direction = following + (following @ following) / (gradient @ gradient) * direction
        gradient = following
    return np.maximum(x, 0)


def _even(matrix: Dense, counts: Dense) -> Dense:
    return np.where(matrix.sum(0) > 0, counts.sum() / matrix.sum(), 0.0)


def _mlem(matrix: Dense, measured: Dense, count: int) -> Dense:
    counts = np.maximum(measured, 0)
    per_column, missing = sensitivity(matrix.sum(0))
    x = _even(matrix, counts)
    for _ in range(count):
        x = x * per_column * (matrix.T @ _ratio(counts, matrix @ x) + missing)
    return x


def _smart(matrix: Dense, measured: Dense, count: int) -> Dense:
    counts = np.maximum(measured, 0)
    per_column, _ = sensitivity(matrix.sum(0))
    x = _even(matrix, counts)
    for _ in range(count):
        logs = np.log(np.maximum(_ratio(counts, matrix @ x), 1e-3))
        x = x * np.exp(per_column * (matrix.T @ logs))
    return x


def _art(matrix: Dense, measured: Dense, count: int) -> Dense:
    squares = (matrix**2).sum(1)
    steps = RELAXATION * _damped(squares)
    order = np.random.default_rng(0).permutation(np.flatnonzero(squares))
    x = np.zeros(matrix.shape[1])
    for pixel in np.tile(order, count):
        row = matrix[pixel]
        x = np.maximum(x + steps[pixel] * (measured[pixel] - row @ x) * row, 0)
    return x


def _mart(matrix: Dense, measured: Dense, count: int) -> Dense:
    counts, powers = np.maximum(measured, 0), RELAXATION * _damped(matrix.max(1))
    order = np.random.default_rng(0).permutation(np.flatnonzero(matrix.any(1)))
    x = _even(matrix, counts)
    for pixel in np.tile(order, count):
        row = matrix[pixel]
        projected = row @ x
        if projected > 0:
            met = row > 0
            quotient = counts[pixel] / projected
            x[met] *= quotient ** (powers[pixel] * row[met])
    return x


def _ratio(counts: Dense, projected: Dense) -> Dense:
    return np.divide(counts, projected, out=np.ones_like(counts), where=projected > 0)


def _damped(sizes: Dense) -> Dense:
    return 1 / np.maximum(sizes, 0.1 * np.median(sizes[sizes > 0]))


def _reciprocal(sums: Dense) -> Dense:
    return np.divide(1.0, sums, out=np.zeros_like(sums), where=sums > 0)


_TWINS: Mapping[str, Callable[[Dense, Dense, int], Dense]] = {
    "art": _art,
    "cgls": _cgls,
    "mart": _mart,
    "mlem": _mlem,
    "sart": _sart,
    "sirt": _sirt,
    "smart": _smart,
}
