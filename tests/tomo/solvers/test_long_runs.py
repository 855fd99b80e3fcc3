"""Far more iterations than anyone asks for, and every method once more in double precision.

Nothing may drift, grow or cease to be a number; what rounding changes is little.
"""

import itertools

import numpy as np
import pytest

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid, solvers
from tomo._compute.reductions import norm
from tomo.losses import sensitivity
from tomo.simulation import simulate_images
from tomo.solvers.sart import view_orders

LONG = 100
ITERATIONS = 20
RELAXATION = 0.5  # of ART and MART
FREE = ("cgls", "nnls")  # without bounds they tend to the least squares of least norm


@pytest.fixture(scope="module")
def system():
    grid = VoxelGrid((6, 12, 6), 1.0)
    rig = rigs.ring(
        5, distance=300.0, image_size=(10, 18), footprint=0.9,
        pitch_degrees=[-10.0, 10.0, -10.0, 10.0, -10.0],
    )  # fmt: skip
    field = phantoms.create("jet", 1, grid.extent, grid.center)
    scan = simulate_images(rig, field, grid, supersample=2, refine=2, noise=0.05)
    made = LinearSystem.from_rig(rig, grid, form="stored")
    return made.projector, made.flatten(list(scan.images.values()))


@pytest.fixture(scope="module", params=["noise alone", "a wild pixel"])
def images(request, system):
    _, measured = system
    if request.param == "noise alone":
        return np.random.default_rng(0).standard_normal(len(measured)).astype(np.float32)
    middle = np.arange(len(measured)) == len(measured) // 2
    return np.where(middle, 1e5 * measured.max(), measured).astype(np.float32)


def run(method, projector, measured, count, **settings):
    return getattr(solvers, method)(projector, measured, iterations=count, **settings)


def residual(projector, measured, found):
    projected = projector @ found.volume.ravel().astype(np.float64)
    return norm(measured - projected) / norm(measured)


@pytest.mark.parametrize("method", solvers.METHODS)
def test_long_runs_neither_drift_nor_grow(system, images, method):
    projector, finite = system[0], []

    def watch(index, volume, _residual):
        finite.append(bool(np.isfinite(volume).all()))

    found = run(method, projector, images, LONG, callback=watch)
    assert all(finite)
    assert found.volume.min() >= 0
    residuals = [entry.relative_residual for entry in found.history]
    assert residuals[-1] <= 1.001 * min(residuals[len(residuals) // 2 :])
    if method != "cgls":  # its record is that of the volume before it is clipped
        assert abs(residual(projector, images, found) - found.relative_residual) < 2e-6
    if method == "mlem":  # keeps the light of the images
        total = float((projector @ found.volume.ravel().astype(np.float64)).sum())
        assert total == pytest.approx(np.maximum(images, 0).sum(dtype=np.float64), rel=1e-5)


@pytest.fixture(scope="module")
def inverse(system):
    return np.linalg.pinv(system[0].to_scipy().toarray().astype(np.float64))


@pytest.mark.parametrize("method", FREE)
def test_long_runs_without_bounds_tend_to_the_least_norm(system, inverse, images, method):
    projector, _ = system
    found = run(method, projector, images, LONG, nonnegative=False)
    assert abs(residual(projector, images, found) - found.relative_residual) < 2e-6
    assert norm(found.volume) <= 1.001 * norm(inverse @ images)


def damped(sizes):
    return 1 / np.maximum(sizes, 0.1 * np.median(sizes[sizes > 0]))


def reciprocal(sums):
    return np.divide(1.0, sums, out=np.zeros_like(sums), where=sums > 0)


def ratio(counts, projected):
    return np.divide(counts, projected, out=np.ones_like(counts), where=projected > 0)


def even(matrix, counts):
    return np.where(matrix.sum(0) > 0, counts.sum() / matrix.sum(), 0.0)


def sirt(matrix, measured, _view_ptr):
    per_row, per_column = damped(matrix.sum(1)), reciprocal(matrix.sum(0))
    x = np.zeros(matrix.shape[1])
    for _ in range(ITERATIONS):
        x = np.maximum(x + per_column * (matrix.T @ (per_row * (measured - matrix @ x))), 0)
    return x


def sart(matrix, measured, view_ptr):
    per_row, x = damped(matrix.sum(1)), np.zeros(matrix.shape[1])
    orders = itertools.islice(view_orders(len(view_ptr) - 1), ITERATIONS)
    for view in itertools.chain.from_iterable(orders):
        own = slice(view_ptr[view], view_ptr[view + 1])
        block, per_column = matrix[own], reciprocal(matrix[own].sum(0))
        pixels = per_row[own] * (measured[own] - block @ x)
        x = np.maximum(x + per_column * (block.T @ pixels), 0)
    return x


def cgls(matrix, measured, _view_ptr):
    x, rest = np.zeros(matrix.shape[1]), measured.copy()
    gradient = direction = matrix.T @ rest
    for _ in range(ITERATIONS):
        image = matrix @ direction
        step = (gradient @ gradient) / (image @ image)
        x, rest = x + step * direction, rest - step * image
        following = matrix.T @ rest
        direction = following + (following @ following) / (gradient @ gradient) * direction
        gradient = following
    return np.maximum(x, 0)


def mlem(matrix, measured, _view_ptr):
    counts = np.maximum(measured, 0)
    per_column, missing = sensitivity(matrix.sum(0))
    x = even(matrix, counts)
    for _ in range(ITERATIONS):
        x = x * per_column * (matrix.T @ ratio(counts, matrix @ x) + missing)
    return x


def smart(matrix, measured, _view_ptr):
    counts = np.maximum(measured, 0)
    per_column, _ = sensitivity(matrix.sum(0))
    x = even(matrix, counts)
    for _ in range(ITERATIONS):
        logs = np.log(np.maximum(ratio(counts, matrix @ x), 1e-3))
        x = x * np.exp(per_column * (matrix.T @ logs))
    return x


def art(matrix, measured, _view_ptr):
    squares = (matrix**2).sum(1)
    steps = RELAXATION * damped(squares)
    order = np.random.default_rng(0).permutation(np.flatnonzero(squares))
    x = np.zeros(matrix.shape[1])
    for pixel in np.tile(order, ITERATIONS):
        row = matrix[pixel]
        x = np.maximum(x + steps[pixel] * (measured[pixel] - row @ x) * row, 0)
    return x


def mart(matrix, measured, _view_ptr):
    counts, powers = np.maximum(measured, 0), RELAXATION * damped(matrix.max(1))
    order = np.random.default_rng(0).permutation(np.flatnonzero(matrix.any(1)))
    x = even(matrix, counts)
    for pixel in np.tile(order, ITERATIONS):
        row = matrix[pixel]
        projected = row @ x
        if projected > 0:
            met = row > 0
            x[met] *= (counts[pixel] / projected) ** (powers[pixel] * row[met])
    return x


TWINS = {twin.__name__: twin for twin in (art, cgls, mart, mlem, sart, sirt, smart)}


@pytest.mark.parametrize("method", TWINS)
def test_single_precision_follows_the_dense_twin_in_double(system, method):
    projector, measured = system
    matrix = projector.to_scipy().toarray().astype(np.float64)
    expected = TWINS[method](matrix, measured.astype(np.float64), projector.view_ptr)
    found = run(method, projector, measured, ITERATIONS).volume.ravel()
    assert norm(found - expected) < 1e-4 * norm(expected)
    assert norm(1.001 * found - expected) > 1e-4 * norm(expected)
