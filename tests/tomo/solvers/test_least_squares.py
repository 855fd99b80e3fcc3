"""Least squares with weights, bounds and penalties, against dense float64 solutions."""

import numpy as np
import pytest
import scipy.optimize
from numpy.testing import assert_allclose

from tomo import metrics, solvers
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.priors import Gradient, TotalVariation

WEIGHTED = ("cgls", "curvature", "nnls", "sirt", "tikhonov", "tv")


@pytest.fixture(scope="module")
def system(projector_of):
    """Return a function that makes a projector onto noisy pixels, its dense matrix, and them.

    Half the voxels are dark.
    """

    def make(seed=0, shape=(3, 4, 3), pixels=60, hole=False):
        random = np.random.default_rng(seed)
        mask = np.ones(shape, bool)
        if hole:
            mask[1, 1:3, 1] = False
            mask[:, -1] = False
        active = ActiveVoxels.from_mask(VoxelGrid(shape, 1.0), mask)
        matrix = random.uniform(0.2, 1.5, (pixels, active.size))
        matrix *= random.random(matrix.shape) < 0.3
        matrix = matrix.astype(np.float32).astype(np.float64)
        truth = np.maximum(random.normal(0, 1, active.size), 0)
        measured = (matrix @ truth + random.normal(0, 0.8, pixels)).astype(np.float32)
        return projector_of(matrix, active=active), matrix, measured

    return make


def _on(projector, found):
    return projector.active.compress(found.volume)


def _dense_gradient(active):
    gradient = Gradient(active)
    unit = np.eye(active.size, dtype=np.float32)
    rows = [gradient.forward(row).T.ravel() for row in unit]  # the three of a place together
    return np.array(rows, np.float64).T


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("pixels", [20, 60])
def test_nnls_finds_the_non_negative_least_squares_solution(system, seed, pixels):
    projector, matrix, measured = system(seed, pixels=pixels)
    expected, misfit = scipy.optimize.nnls(matrix, measured.astype(np.float64))
    found = solvers.nnls(projector, measured, iterations=400)
    scale = np.linalg.norm(measured)
    assert found.relative_residual == pytest.approx(misfit / scale, abs=1e-6)
    if pixels > matrix.shape[1]:
        assert_allclose(_on(projector, found), expected, atol=2e-5)
        assert (expected == 0).sum() > 5


def test_nnls_without_the_bound_is_least_squares(system):
    projector, matrix, measured = system()
    expected = np.linalg.lstsq(matrix, measured, rcond=None)[0]
    found = solvers.nnls(projector, measured, iterations=100, nonnegative=False)
    assert_allclose(_on(projector, found), expected, rtol=1e-4, atol=1e-5)


def test_nnls_is_as_fast_as_cgls_on_clean_images(ring_system):
    case = ring_system
    distances = [
        metrics.cosine_distance(
            method(case.projector, case.measured, iterations=14).volume, case.truth
        )
        for method in (solvers.cgls, solvers.nnls)
    ]
    assert distances[1] < 1e-3
    assert distances[1] < 2 * distances[0]


@pytest.mark.parametrize("method", ["nnls", "tikhonov"])
def test_the_objective_falls_at_every_update(ring_system, method):
    projector = ring_system.projector
    random = np.random.default_rng(0)
    measured = ring_system.measured + random.normal(0, 0.3, len(ring_system.measured))
    gradient = Gradient(projector.active)
    factor = float((projector.T @ (projector @ np.ones(projector.shape[1]))).max())
    strength = 0.003 if method == "tikhonov" else 0.0
    values = []

    def watch(index, volume, residual):
        misfit = np.linalg.norm(measured.astype(np.float32) - projector @ volume.astype("f8"))
        rough = np.linalg.norm(gradient.forward(volume).astype(np.float64))
        values.append(misfit**2 + strength * factor * rough**2)

    more = {"strength": strength} if strength else {}
    getattr(solvers, method)(projector, measured, iterations=40, callback=watch, **more)
    steps = np.diff(values)
    assert steps.max() < 1e-6 * values[-1]
    assert (steps[:15] < 0).all()


@pytest.mark.parametrize("hole", [False, True])
@pytest.mark.parametrize("nonnegative", [True, False])
def test_tikhonov_finds_the_minimum(system, hole, nonnegative):
    projector, matrix, measured = system(3, hole=hole)
    strength, weights = 0.02, np.random.default_rng(1).uniform(0.1, 3, len(measured))
    found = solvers.tikhonov(
        projector, measured, strength=strength, iterations=300, weights=weights,
        nonnegative=nonnegative,
    )  # fmt: skip
    root = np.sqrt(weights)
    weighted = root[:, None] * matrix
    factor = (weighted.T @ (weighted @ np.ones(matrix.shape[1]))).max()
    rough = np.sqrt(strength * factor) * _dense_gradient(projector.active)
    rows = np.vstack([weighted, rough])
    target = np.concatenate([root * measured, np.zeros(len(rough))])
    lowest = 0 if nonnegative else -np.inf
    expected = scipy.optimize.lsq_linear(rows, target, (lowest, np.inf), tol=1e-14).x
    assert_allclose(_on(projector, found), expected, atol=5e-5)
    assert (expected.min() < -0.01) != nonnegative


@pytest.mark.parametrize("strength", [0.01, 1.0])
def test_damping_is_ridge_regression(system, strength):
    projector, matrix, measured = system(4)
    found = solvers.cgls(projector, measured, strength=strength, iterations=60, nonnegative=False)
    factor = (matrix.T @ (matrix @ np.ones(matrix.shape[1]))).max()
    normal = matrix.T @ matrix + strength * factor * np.eye(matrix.shape[1])
    expected = np.linalg.solve(normal, matrix.T @ measured)
    assert_allclose(_on(projector, found), expected, rtol=1e-4, atol=1e-6)


def tv_twin(matrix, measured, gradient, weight, steps=30000):
    """Return the minimum by Chambolle and Pock's primal-dual steps, dense and in double."""
    bound = np.linalg.norm(np.vstack([matrix, gradient]), 2)
    x = ahead = np.zeros(matrix.shape[1])
    p, q = np.zeros(len(matrix)), np.zeros(len(gradient))
    for _ in range(steps):
        p = (p + (matrix @ ahead - measured) / bound) / (1 + 1 / bound)
        q = q + gradient @ ahead / bound
        lengths = np.linalg.norm(q.reshape(-1, 3), axis=1, keepdims=True)
        q = (q.reshape(-1, 3) / np.maximum(lengths / weight, 1)).ravel()
        moved = np.maximum(x - (matrix.T @ p + gradient.T @ q) / bound, 0)
        x, ahead = moved, 2 * moved - x
    return x


@pytest.mark.parametrize("hole", [False, True])
@pytest.mark.parametrize("strength", [0.02, 0.1])
def test_tv_finds_the_minimum(system, hole, strength):
    projector, matrix, measured = system(5, hole=hole)
    found = solvers.tv(projector, measured, strength=strength, iterations=2000)
    weight = strength * np.abs(matrix.T @ measured).max()
    expected = tv_twin(matrix, measured, _dense_gradient(projector.active), weight)
    assert_allclose(_on(projector, found), expected, atol=2e-4)


def test_tv_without_strength_is_non_negative_least_squares(system):
    projector, matrix, measured = system(6)
    found = solvers.tv(projector, measured, strength=0, iterations=2000)
    expected, _ = scipy.optimize.nnls(matrix, measured.astype(np.float64))
    assert_allclose(_on(projector, found), expected, atol=1e-4)


def test_more_strength_is_less_variation_and_a_worse_fit(ring_system):
    case = ring_system
    random = np.random.default_rng(0)
    measured = case.measured + random.normal(0, 0.3, len(case.measured))
    variation = TotalVariation(case.projector.active)
    found = [
        solvers.tv(case.projector, measured, strength=s, iterations=60)
        for s in (0, 0.003, 0.03, 0.3, 3)
    ]
    variations = [variation.value(one.volume.ravel()) for one in found]
    residuals = [one.relative_residual for one in found]
    assert (np.diff(variations) < 0).all()
    assert (np.diff(residuals) > 0).all()
    distances = [metrics.cosine_distance(one.volume, case.truth) for one in found[:4]]
    assert min(distances[1:3]) < 0.5 * distances[0]


@pytest.mark.parametrize("method", WEIGHTED)
def test_doubling_the_images_doubles_the_volume_exactly(system, method):
    projector, _, measured = system(7)
    solver = getattr(solvers, method)
    once = solver(projector, measured, iterations=8).volume
    np.testing.assert_array_equal(solver(projector, 2 * measured, iterations=8).volume, 2 * once)


@pytest.mark.parametrize("method", WEIGHTED)
def test_a_weight_is_worth_so_many_equal_rows(projector_of, system, method):
    projector, matrix, measured = system(8)
    weights = np.random.default_rng(0).integers(0, 4, len(measured))
    repeated = projector_of(np.repeat(matrix, weights, axis=0), active=projector.active)
    solver = getattr(solvers, method)
    found = solver(projector, measured, weights=weights, iterations=3)
    expected = solver(repeated, np.repeat(measured, weights), iterations=3)
    assert_allclose(found.volume, expected.volume, rtol=1e-3, atol=1e-4)
    if method != "sirt":  # which weighs rows by their sums as well
        residuals = [line.relative_residual for line in found.history]
        assert_allclose(
            residuals, [line.relative_residual for line in expected.history], rtol=1e-4
        )
    unweighted = solver(projector, measured, iterations=3)
    assert np.abs(found.volume - unweighted.volume).max() > 0.01


@pytest.mark.parametrize("method", WEIGHTED)
@pytest.mark.parametrize("factor", [1.0, 1e-30, 1e30])
def test_a_common_weight_changes_nothing(system, method, factor):
    projector, _, measured = system(9)
    solver = getattr(solvers, method)
    expected = solver(projector, measured, iterations=3)
    found = solver(projector, measured, weights=np.full(60, factor), iterations=3)
    assert_allclose(found.volume, expected.volume, rtol=1e-4, atol=1e-5)
    assert found.settings["weighted"] is True
    assert expected.settings["weighted"] is False


@pytest.mark.parametrize("method", WEIGHTED)
def test_pixels_without_weight_do_not_count(system, method):
    projector, _, measured = system(10)
    weights = np.ones(60)
    weights[::7] = 0
    wrong = np.where(weights == 0, 1e3, measured)
    solver = getattr(solvers, method)
    expected = solver(projector, np.where(weights == 0, 0, measured), weights=weights)
    found = solver(projector, wrong, weights=weights)
    assert_allclose(found.volume, expected.volume, rtol=2e-3, atol=2e-3)
    dark = solver(projector, measured, weights=np.zeros(60), iterations=3)
    np.testing.assert_array_equal(dark.volume, 0)


@pytest.mark.parametrize("method", WEIGHTED)
@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.ones(7), "weights: found 7, expected one for each of the projector's 60 pixels"),
        (np.full(60, -1.0), "weights: found 60 negative, NaN or infinite, expected >= 0"),
        (np.full(60, np.nan), "weights: found 60 negative, NaN or infinite"),
        (np.full(60, np.inf), "weights: found 60 negative, NaN or infinite"),
    ],
)
def test_bad_weights_are_refused(system, method, bad, message):
    projector, _, measured = system()
    with pytest.raises(ValueError, match=message):
        getattr(solvers, method)(projector, measured, weights=bad)


@pytest.mark.parametrize("method", ["cgls", "curvature", "tikhonov", "tv"])
@pytest.mark.parametrize("bad", [-1e-9, np.nan, np.inf])
def test_bad_strengths_are_refused(system, method, bad):
    projector, _, measured = system()
    with pytest.raises(ValueError, match=r"strength: found .*, expected a finite number >= 0"):
        getattr(solvers, method)(projector, measured, strength=bad)


@pytest.mark.parametrize("method", ["nnls", "tikhonov", "tv"])
def test_a_start_near_the_end_saves_iterations(ring_system, method):
    case = ring_system
    solver = getattr(solvers, method)
    more = {"strength": 0.002} if method != "nnls" else {}
    nearly = {"strength": 0.003} if method != "nnls" else {}
    measured = case.measured + np.random.default_rng(0).normal(0, 0.1, len(case.measured))
    end = solver(case.projector, measured, iterations=150, **more).volume
    near = solver(case.projector, measured, iterations=100, **nearly).volume
    cold = solver(case.projector, measured, iterations=5, **more).volume
    warm = solver(case.projector, measured, iterations=5, start=near, **more).volume
    assert np.linalg.norm(warm - end) < 0.5 * np.linalg.norm(cold - end)


@pytest.mark.parametrize("method", ["curvature", "tikhonov", "tv"])
def test_voxels_out_of_sight_follow_their_neighbours(projector_of, method):
    random = np.random.default_rng(0)
    matrix = random.uniform(0.5, 1, (20, 9))
    matrix[:, 4] = 0
    projector = projector_of(matrix)
    measured = matrix @ np.full(9, 2.0)
    found = getattr(solvers, method)(projector, measured, strength=1e-3, iterations=500)
    assert_allclose(found.volume.ravel(), 2, atol=0.02)


def test_subsets_make_sirt_faster(ring_system):
    case = ring_system
    together = solvers.sirt(case.projector, case.measured, iterations=5)
    parts = solvers.sirt(case.projector, case.measured, iterations=5, subsets=6)
    assert parts.relative_residual < 0.3 * together.relative_residual
    distances = [metrics.cosine_distance(one.volume, case.truth) for one in (together, parts)]
    assert distances[1] < 0.6 * distances[0]


def test_smart_finds_the_solution_of_largest_entropy(projector_of):
    matrix = np.array([[1, 1, 0, 0], [0, 0, 1, 1], [1, 0, 1, 0], [0, 1, 0, 1]], float)
    measured = matrix @ [1.0, 2.0, 3.0, 4.0]  # many solutions; the product form has most entropy
    found = solvers.smart(projector_of(matrix), measured, iterations=400)
    assert_allclose(found.volume.reshape(2, 2), np.outer([3, 7], [4, 6]) / 10, rtol=1e-4)


def test_smart_descends_the_cross_entropy(ring_system):
    projector = ring_system.projector
    scale = 300 / ring_system.measured.max()
    counts = np.random.default_rng(0).poisson(scale * ring_system.measured) + np.float32(1)
    counts[projector.row_sums == 0] = 0
    some, values = counts > 0, []

    def watch(index, volume, residual):
        projected = (projector @ volume.astype(np.float64))[some]
        values.append(np.sum(projected * np.log(projected / counts[some]) - projected))

    solvers.smart(projector, counts, iterations=40, callback=watch)
    steps = np.diff(values)
    assert (steps[:10] < 0).all()
    assert steps.max() < 1e-9 * abs(values[-1])
