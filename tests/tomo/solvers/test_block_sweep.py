"""Blocks of pixels one after another, against a slow twin in double precision."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from tomo import ActiveVoxels, GaussianBasis, Projector
from tomo.solvers import _block_sweep, sart, sirt
from tomo.solvers._block_sweep import sweep_of
from tomo.solvers.iterate import interleaved
from tomo.solvers.sart import view_orders


def _twin(matrix, measured, parts, x, relaxation, nonnegative, weights, least):
    rows = matrix.sum(1)
    damped = np.maximum(rows, 0.1 * np.median(rows[rows > 0]))
    for pixels in parts:
        block, weight, per_row = matrix[pixels], weights[pixels], 1 / damped[pixels]
        columns = np.where(block.any(0), np.maximum(weight @ block, least), 0)
        per_column = np.divide(1.0, columns, out=np.zeros_like(columns), where=columns > 0)
        residual = measured[pixels] - block @ x
        x = x + relaxation * per_column * (block.T @ (weight * per_row * residual))
        x = np.maximum(x, 0) if nonnegative else x
    return x


@pytest.fixture(params=["ring_system", "supersampled", "bricks"])
def case(request, ring_system, in_bricks):
    """Systems whose rows hold a voxel once, several times, and in another order."""
    return in_bricks if request.param == "bricks" else request.getfixturevalue(request.param)


@pytest.fixture
def in_bricks(ring_system, monkeypatch):
    """Return the ring's system with its entries sorted by bricks, as those of many voxels are."""
    monkeypatch.setattr("tomo.grid.active_voxels.FEW_VOXELS", 10)
    own = ring_system.projector
    projector = Projector(own.segments, own.grid, own.view_ptr, ActiveVoxels(own.grid))
    assert projector.active.storage_index is not None
    return SimpleNamespace(projector=projector, measured=ring_system.measured)


def _noisy(measured, seed=0):
    random = np.random.default_rng(seed)
    noise = 0.1 * measured.max() * random.standard_normal(len(measured))
    return (measured + noise).astype(np.float32)


@pytest.mark.parametrize(
    ("subsets", "relaxation", "nonnegative"), [(2, 1.0, True), (9, 0.3, False)]
)
@pytest.mark.parametrize(("cut", "fair"), [(1, False), (1, True), (5, True)])
def test_it_updates_as_its_twin_does(
    case, dense, subsets, relaxation, nonnegative, cut, fair, monkeypatch
):
    """Also where blocks are cut into more parts than have a volume of their own at a time."""
    if cut > 1:
        monkeypatch.setattr(
            _block_sweep,
            "part_bounds",
            lambda counts, _: np.linspace(0, len(counts), cut + 1).astype(np.int64),
        )
        monkeypatch.setattr(_block_sweep, "parts_at_once", lambda *_: 2)
    projector, measured = case.projector, _noisy(case.measured)
    parts = interleaved(len(measured), subsets)
    weights = np.random.default_rng(1).random(len(measured)).astype(np.float32)
    weights[::7] = 0
    start = np.random.default_rng(2).random(projector.shape[1]).astype(np.float32)
    kept = start.copy()
    sweep = sweep_of(projector, measured, parts, weights, fair=fair)
    order = np.random.default_rng(3).permutation(subsets)
    found = sweep(start, relaxation, nonnegative, order)
    found = sweep(found, relaxation, nonnegative, order[::-1].copy())
    in_order = [parts[number] for number in [*order, *order[::-1]]]
    matrix = dense(projector)
    least = weights @ matrix / subsets * fair
    expected = _twin(matrix, measured, in_order, start, relaxation, nonnegative, weights, least)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-5 * np.abs(expected).max())
    assert (found < 0).any() != nonnegative
    np.testing.assert_array_equal(start, kept)


def test_a_matrix_that_is_not_stored_as_it_is_gives_the_same(ring_system):
    """Another operator with the same entries goes block by block through products."""
    projector, measured = ring_system.projector, _noisy(ring_system.measured)
    other_form = GaussianBasis(projector, 1.0, blur=lambda coefficients: coefficients)
    for solve, settings in ((sart, {}), (sirt, {"subsets": 4}), (sirt, {"subsets": 1})):
        stored = solve(projector, measured, iterations=3, **settings)
        other = solve(other_form, measured, iterations=3, **settings)
        np.testing.assert_allclose(
            other.volume, stored.volume, rtol=0, atol=1e-6 * stored.volume.max()
        )
        assert [line.relative_residual for line in other.history] == pytest.approx(
            [line.relative_residual for line in stored.history], rel=1e-6
        )


def test_the_number_of_threads_changes_no_bit(ring_system, monkeypatch, on_threads):
    monkeypatch.setattr("tomo._compute.threads.WORTH_WAKING", 1e-3)
    measured = _noisy(ring_system.measured)
    found = []
    for threads in (1, 2):
        with on_threads(threads):
            sweep = sweep_of(ring_system.projector, measured, interleaved(len(measured), 3))
            x = np.zeros(ring_system.projector.shape[1], np.float32)
            found.append(sweep(x, 1.0, True, np.arange(3)))
    np.testing.assert_array_equal(*found)


def test_what_overflows_does_not_pass_for_zero(ring_system):
    """A voxel that is not a number stays one, so that the solver sees that it diverged."""
    measured = np.full(len(ring_system.measured), np.nan, np.float32)
    x = np.zeros(ring_system.projector.shape[1], np.float32)
    sweep = sweep_of(ring_system.projector, measured, [np.arange(len(measured))])
    found = sweep(x, 1.0, True, np.arange(1))
    assert np.isnan(found).any()


def test_only_sarts_pass_from_zeros_takes_the_views_without_a_pattern(ring_system):
    first, second, third = (order.tolist() for order in itertools.islice(view_orders(9), 3))
    assert first != second == third
    assert sorted(first) == sorted(second) == list(range(9))
    projector, measured = ring_system.projector, ring_system.measured
    zeros = np.zeros(projector.shape[1])
    from_nothing, from_zeros = (
        sart(projector, measured, iterations=1, start=start).volume for start in (None, zeros)
    )
    assert np.abs(from_zeros - from_nothing).max() > 1e-3
