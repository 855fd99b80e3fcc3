"""What each method converges to, against dense float64 linear algebra."""

import numpy as np
import pytest

from tomo import metrics, solvers

ENOUGH = {
    "art": {"iterations": 60},
    "cgls": {"iterations": 60},
    "curvature": {"iterations": 60, "strength": 1e-7},
    "l1": {"iterations": 200, "strength": 1e-6},
    "mart": {"iterations": 60},
    "mlem": {"iterations": 400},
    "nnls": {"iterations": 60},
    "sart": {"iterations": 60},
    "sirt": {"iterations": 400},
    "smart": {"iterations": 400},
    "tikhonov": {"iterations": 60, "strength": 1e-7},
    "tv": {"iterations": 200, "strength": 1e-6},
}


def _error(found, truth):
    return np.linalg.norm(found.ravel() - truth.ravel()) / np.linalg.norm(truth)


def _overdetermined(seed=0, noise=0.3):
    random = np.random.default_rng(seed)
    matrix = random.uniform(0.2, 1.5, (30, 8)) * (random.random((30, 8)) < 0.6)
    matrix = matrix.astype(np.float32).astype(np.float64)
    truth = random.uniform(0.5, 2, 8)
    measured = matrix @ truth + noise * random.standard_normal(30)
    return matrix, truth, measured.astype(np.float32).astype(np.float64)


@pytest.mark.parametrize(
    ("method", "system"),
    [
        *((method, "ring_system") for method in solvers.METHODS),
        # by rows, by blocks of them, by products, and by products of factors
        *((method, "supersampled") for method in ("art", "mart", "sart", "cgls", "mlem")),
    ],
)
def test_clean_images_lead_to_the_truth(request, system, method):
    case = request.getfixturevalue(system)
    found = getattr(solvers, method)(case.projector, case.measured, **ENOUGH[method])
    assert found.relative_residual < 5e-3
    assert metrics.cosine_distance(found.volume, case.truth) < 1e-3


def test_multiplicative_subsets_lead_to_the_truth_sooner(ring_system):
    projector, measured = ring_system.projector, ring_system.measured
    together = solvers.mlem(projector, measured, iterations=2)
    in_subsets = solvers.mlem(projector, measured, iterations=2, subsets=2)
    truth = ring_system.truth
    assert _error(in_subsets.volume, truth) < 0.7 * _error(together.volume, truth)
    assert in_subsets.relative_residual < 0.7 * together.relative_residual


def test_cgls_ends_after_as_many_updates_as_there_are_different_singular_values(projector_of):
    random = np.random.default_rng(1)
    left, _ = np.linalg.qr(random.standard_normal((40, 12)))
    right, _ = np.linalg.qr(random.standard_normal((12, 12)))
    matrix = left * np.repeat([3.0, 2.0, 1.0], 4) @ right
    truth = random.uniform(0.5, 2, 12)
    found = solvers.cgls(projector_of(matrix), matrix @ truth, iterations=3, nonnegative=False)
    np.testing.assert_allclose(found.volume.ravel(), truth, rtol=1e-5)


def test_cgls_stops_by_itself_where_single_precision_ends(projector_of):
    matrix, truth, _ = _overdetermined(seed=3)
    found = solvers.cgls(projector_of(matrix), matrix @ truth, iterations=1000)
    assert found.stop_reason.startswith("converged at iteration")
    assert len(found.history) < 100


@pytest.mark.parametrize("images", ["noise", "one wild pixel"])
@pytest.mark.parametrize("nonnegative", [True, False])
@pytest.mark.parametrize("method", ["cgls", "nnls"])
def test_images_that_no_volume_explains_end_in_no_growth(ring_system, method, nonnegative, images):
    pixels = len(ring_system.measured)
    measured = np.random.default_rng(0).standard_normal(pixels)
    if images == "one wild pixel":
        measured = np.where(np.arange(pixels) == pixels // 2, 1e5, ring_system.measured)
    solver = getattr(solvers, method)
    found = solver(ring_system.projector, measured, iterations=4000, nonnegative=nonnegative)
    lowest = min(entry.relative_residual for entry in found.history)
    assert found.stop_reason.startswith("converged")
    assert found.relative_residual <= lowest * (1 + 1e-6)


@pytest.mark.parametrize("method", ["art", "cgls", "nnls", "sirt", "sart"])
def test_from_zero_an_underdetermined_system_gets_its_solution_of_least_norm(projector_of, method):
    random = np.random.default_rng(4)
    matrix = random.uniform(0.2, 1.5, (5, 12)).astype(np.float32).astype(np.float64)
    truth = random.uniform(0.5, 2, 12)
    measured = matrix @ truth
    if method in ("sirt", "sart"):  # least in the norm weighted by the column sums
        weight = np.sqrt(matrix.sum(axis=0))
        if method == "sart":
            matrix = matrix / matrix.sum(axis=0)  # one view: equal column sums in every block
            measured = matrix @ truth
            weight = np.ones(12)
        expected = np.linalg.pinv(matrix / weight) @ measured / weight
    else:
        expected = np.linalg.pinv(matrix) @ measured
    found = getattr(solvers, method)(
        projector_of(matrix), measured, iterations=4000, nonnegative=False
    )
    np.testing.assert_allclose(found.volume.ravel(), expected, rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize("relaxation", [0.3, 1.0, 1.9])
def test_sirt_finds_the_weighted_least_squares_solution(projector_of, relaxation):
    matrix, _, measured = _overdetermined(seed=1)
    found = solvers.sirt(
        projector_of(matrix), measured, iterations=3000, nonnegative=False, relaxation=relaxation
    )
    weight = 1 / np.sqrt(matrix.sum(axis=1))
    expected = np.linalg.lstsq(weight[:, None] * matrix, weight * measured, rcond=None)[0]
    plain = np.linalg.lstsq(matrix, measured, rcond=None)[0]
    np.testing.assert_allclose(found.volume.ravel(), expected, rtol=1e-4, atol=1e-5)
    assert np.abs(expected - plain).max() > 1e-2  # the weights matter here


def test_nonnegative_sirt_satisfies_the_conditions_of_the_bounded_problem(projector_of):
    matrix, truth, _ = _overdetermined(seed=5)
    truth[:3] = 0
    random = np.random.default_rng(6)
    measured = matrix @ truth + 0.5 * random.standard_normal(30)
    found = solvers.sirt(projector_of(matrix), measured, iterations=5000).volume.ravel()
    gradient = matrix.T @ ((measured - matrix @ found) / matrix.sum(axis=1))
    at_zero = found == 0
    assert at_zero.any()
    assert np.abs(gradient[~at_zero]).max() < 1e-5
    assert gradient[at_zero].max() < 1e-5


def _poisson_likelihood(projected, counts):
    some = counts > 0
    return np.sum(counts[some] * np.log(projected[some])) - projected.sum()


def test_mlem_keeps_the_total_and_its_likelihood_never_falls(ring_system):
    projector = ring_system.projector
    scale = 300 / ring_system.measured.max()
    counts = np.random.default_rng(0).poisson(scale * ring_system.measured).astype(np.float32)
    counts[projector.row_sums == 0] = 0
    totals, likelihoods = [], []

    def watch(index, volume, residual):
        projected = projector @ volume.astype(np.float64)
        totals.append(projected.sum())
        likelihoods.append(_poisson_likelihood(projected, counts))

    solvers.mlem(projector, counts, iterations=40, callback=watch)
    np.testing.assert_allclose(totals, counts.sum(), rtol=1e-6)
    steps = np.diff(likelihoods)
    assert steps[:10].min() > 0
    assert steps.min() > -1e-9 * abs(likelihoods[-1])


def test_mlem_finds_the_stationary_point_of_the_likelihood(projector_of):
    matrix, truth, _ = _overdetermined(seed=7)
    measured = np.random.default_rng(1).poisson(20 * matrix @ truth)
    found = solvers.mlem(projector_of(matrix), measured, iterations=3000).volume.ravel()
    gradient = matrix.T @ (1 - measured / (matrix @ found))
    assert (found > 0).all()
    assert np.abs(gradient).max() < 1e-4 * matrix.sum(axis=0).max()


def test_mart_tends_to_the_solution_of_largest_entropy(projector_of):
    # Equal chords: the exponents are then those of the theory (Lent 1977).
    matrix = np.array([[1, 1, 0, 0], [0, 0, 1, 1], [1, 0, 1, 0], [0, 1, 0, 1]], float)
    measured = matrix @ [1.0, 2.0, 3.0, 4.0]  # many solutions; the product form has most entropy
    found = solvers.mart(projector_of(matrix), measured, iterations=200, relaxation=1.0)
    expected = np.outer([3, 7], [4, 6]) / 10
    np.testing.assert_allclose(found.volume.reshape(2, 2), expected, rtol=1e-4)


def test_ordered_subsets_survive_pixels_too_faint_for_a_ratio_in_single_precision(projector_of):
    projector = projector_of([[1.0], [1.0]])
    with np.errstate(all="raise", under="ignore"):
        found = solvers.mlem(projector, [1.0, 1e-40], iterations=3, subsets=2)
    assert found.stop_reason == "all 3 iterations done"
    assert np.isfinite(found.volume).all()
