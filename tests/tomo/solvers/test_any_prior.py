"""A prior that no solver knows works with the solvers of its kind; parameters are documented."""

import inspect

import numpy as np
import pytest
import scipy.optimize
from numpy.testing import assert_allclose

from tomo import priors, solvers
from tomo.priors import L1, Gradient, TotalVariation
from tomo.solvers.methods import NONE


class Towards:
    """Differences from a known matrix: ``||K x||²``."""

    def __init__(self, matrix):
        self.matrix = matrix.astype(np.float32)

    def forward(self, values):
        return self.matrix @ values

    def adjoint(self, field):
        return self.matrix.T @ field


class Sum:
    """The sum of magnitudes, ``R(x) = sum |x|``: its proximal map is a soft threshold."""

    def proximal_map(self, inverse, nonnegative):
        def threshold(center, weight, steps, stretch=1.0):
            shrunk = np.maximum(np.abs(center) - weight * stretch * inverse, 0) * np.sign(center)
            return np.maximum(shrunk, 0) if nonnegative else shrunk

        return threshold


@pytest.fixture
def noisy(projector_of):
    random = np.random.default_rng(0)
    matrix = random.uniform(0.2, 1.5, (60, 12)) * (random.random((60, 12)) < 0.5)
    measured = matrix @ np.maximum(random.normal(0, 1, 12), 0) + random.normal(0, 0.3, 60)
    return projector_of(matrix), matrix, measured.astype(np.float32)


@pytest.mark.parametrize(
    ("solver", "nonnegative"),
    [(solvers.projected_cg, True), (solvers.projected_cg, False), (solvers.cgls, False)],
)
def test_a_linear_prior(noisy, solver, nonnegative):
    projector, matrix, measured = noisy
    known = np.random.default_rng(1).normal(0, 1, (7, 12))
    found = solver(
        projector, measured, prior=Towards(known), strength=0.05, iterations=300,
        nonnegative=nonnegative,
    )  # fmt: skip
    factor = (matrix.T @ (matrix @ np.ones(12))).max()
    rows = np.vstack([matrix, np.sqrt(0.05 * factor) * known])
    lowest = 0 if nonnegative else -np.inf
    expected = scipy.optimize.lsq_linear(
        rows, np.concatenate([measured, np.zeros(7)]), (lowest, np.inf), tol=1e-14
    ).x
    assert_allclose(found.volume.ravel(), expected, atol=1e-4)
    assert found.settings["strength"] == 0.05


@pytest.mark.parametrize("own", [True, False])
def test_a_proximal_prior(noisy, own):
    projector, matrix, measured = noisy
    prior = Sum() if own else L1(projector.active)
    found = solvers.proximal_gradient(
        projector, measured, prior=prior, strength=0.05, iterations=3000
    )
    weight = 0.05 * np.abs(matrix.T @ measured).max()

    def objective(x):
        residual = measured - matrix @ x
        return residual @ residual / 2 + weight * x.sum(), weight - matrix.T @ residual

    expected = scipy.optimize.minimize(
        objective, np.ones(12), jac=True, bounds=[(0, None)] * 12, method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-9},
    ).x  # fmt: skip
    assert_allclose(found.volume.ravel(), expected, atol=1e-3)


class Square:
    """``R(x) = ||x||²/2`` by its proximal map."""

    def proximal_map(self, inverse, nonnegative):
        def shrunk(center, weight, steps, stretch=1.0):
            found = center / (1 + np.float32(weight * stretch) * inverse)
            return np.maximum(found, 0) if nonnegative else found

        return shrunk


STEPS = np.diff(np.eye(12), axis=0)  # (11, 12): the differences of neighbours


@pytest.mark.parametrize("prior", ["l1", "square", "total variation"])
def test_the_likelihood_with_a_proximal_prior(noisy, prior):
    projector, matrix, measured = noisy
    measured = np.maximum(measured, 0).astype(np.float64)
    given = {"l1": Sum(), "square": Square(), "total variation": TotalVariation(projector.active)}
    settings = {"prior": given[prior], "strength": 0.05, "iterations": 3000}
    found = solvers.mlem(projector, measured, **settings)
    weight = 0.05 * matrix.sum(axis=0).max()

    def objective(both):
        """Return likelihood and prior of unknowns and bounds on steps, and the gradient."""
        x, steps = both[:12], both[12:]
        image = np.maximum(matrix @ x, 1e-12)
        value = image.sum() - measured @ np.log(image)
        slope = matrix.sum(axis=0) - matrix.T @ (measured / image)
        if prior == "l1":
            value, slope = value + weight * x.sum(), slope + weight
        if prior == "square":
            value, slope = value + weight * x @ x / 2, slope + weight * x
        along = weight * (prior == "total variation")
        return value + along * steps.sum(), np.concatenate([slope, np.full(11, along)])

    sides = [np.hstack([sign * STEPS, np.eye(11)]) for sign in (1, -1)]
    expected = scipy.optimize.minimize(
        objective, np.ones(23), jac=True, bounds=[(0, None)] * 23, method="SLSQP",
        constraints={"type": "ineq", "fun": lambda both: np.vstack(sides) @ both},
        options={"ftol": 1e-13, "maxiter": 2000},
    ).x[:12]  # fmt: skip
    assert_allclose(found.volume.ravel(), expected, atol=3e-3)
    plain = solvers.mlem(projector, measured, iterations=3000).volume.ravel()
    assert np.abs(plain - expected).max() > 0.03
    assert found.settings["strength"] == 0.05


def test_subsets_with_a_prior_come_close_sooner(noisy):
    projector, _, measured = noisy
    settings = {"prior": TotalVariation(projector.active), "strength": 0.05}
    whole = solvers.mlem(projector, measured, iterations=3000, **settings).volume
    few = solvers.mlem(projector, measured, iterations=5, **settings).volume
    subsets = solvers.mlem(projector, measured, iterations=5, subsets=3, **settings).volume
    assert np.linalg.norm(subsets - whole) < 0.7 * np.linalg.norm(few - whole)


def test_the_strength_of_a_prior_of_the_likelihood_has_no_unit(noisy, projector_of):
    projector, matrix, measured = noisy
    settings = {"prior": L1(projector.active), "strength": 0.1, "iterations": 20}
    expected = solvers.mlem(projector, measured, **settings).volume
    longer = solvers.mlem(projector_of(7 * matrix), 3 * measured, **settings).volume
    assert_allclose(longer, expected * 3 / 7, rtol=1e-4, atol=1e-6)


def test_a_prior_of_another_kind_is_refused(noisy):
    projector, _, measured = noisy
    linear, proximal = Gradient(projector.active), TotalVariation(projector.active)
    for solver, prior in (
        (solvers.cgls, proximal), (solvers.projected_cg, proximal),
        (solvers.mlem, linear), (solvers.proximal_gradient, linear),
    ):  # fmt: skip
        with pytest.raises(TypeError, match=r"prior: found \w+, expected one with ") as error:
            solver(projector, measured, prior=prior, strength=0.1)
        assert type(prior).__name__ in str(error.value)


def test_rows_name_losses_priors_and_solvers_that_there_are():
    for name, row in solvers.METHODS.items():
        assert row.name == name
        assert callable(getattr(solvers, row.solver))
        assert row.prior == NONE or hasattr(priors, priors.PRIORS[row.prior])
        parameters = inspect.signature(getattr(solvers, name)).parameters
        assert all(parameters[key].default == value for key, value in row.defaults.items())
    assert list(solvers.METHODS) == sorted(solvers.METHODS)


@pytest.mark.parametrize("name", [r.name for r in solvers.METHODS.values() if r.solver != r.name])
def test_a_named_method_takes_no_other_prior(noisy, name):
    projector, _, measured = noisy
    with pytest.raises(TypeError, match="prior"):
        getattr(solvers, name)(projector, measured, prior=Sum())
    with pytest.raises(TypeError, match="positional"):
        getattr(solvers, name)(projector, measured, 3)


def test_l1_leaves_dark_what_is_dark_and_nothing_at_the_largest_strength(noisy):
    projector, _, measured = noisy
    dark = [
        int((solvers.l1(projector, measured, strength=s, iterations=300).volume == 0).sum())
        for s in (0.0, 0.1, 0.5, 1.0)
    ]
    assert dark == sorted(dark)
    assert dark[0] < dark[1] < dark[-1] == 12


def test_named_methods_are_combinations(noisy):
    projector, _, measured = noisy
    pairs = [
        (solvers.nnls, solvers.projected_cg, {}),
        (solvers.tikhonov, solvers.projected_cg, {"prior": Gradient(projector.active)}),
        (solvers.tv, solvers.proximal_gradient, {"prior": TotalVariation(projector.active)}),
        (solvers.l1, solvers.proximal_gradient, {"prior": L1(projector.active)}),
    ]
    for method, solver, prior in pairs:
        strength = {"strength": 0.01} if prior else {}
        named = method(projector, measured, iterations=9, **strength)
        found = solver(projector, measured, iterations=9, **prior, **strength)
        np.testing.assert_array_equal(named.volume, found.volume)


@pytest.mark.parametrize("name", [*solvers.METHODS, "projected_cg", "proximal_gradient"])
def test_every_parameter_is_documented_and_every_formula_stands_under_notes(name):
    solver = getattr(solvers, name)
    text = inspect.getdoc(solver)
    assert "{" not in text.split("Notes\n")[0]
    for parameter in inspect.signature(solver).parameters:
        assert f"\n{parameter} : " in text
    assert "``" in text.split("\nNotes\n-----\n")[1]
