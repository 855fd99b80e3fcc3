"""A prior that no solver knows works with the solvers of its kind; parameters are documented."""

import inspect

import numpy as np
import pytest
import scipy.optimize
from numpy.testing import assert_allclose

from tomo import solvers
from tomo.priors import Gradient, TotalVariation


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


def test_a_linear_prior(noisy):
    projector, matrix, measured = noisy
    known = np.random.default_rng(1).normal(0, 1, (7, 12))
    found = solvers.projected_cg(
        projector, measured, prior=Towards(known), strength=0.05, iterations=300
    )
    factor = (matrix.T @ (matrix @ np.ones(12))).max()
    rows = np.vstack([matrix, np.sqrt(0.05 * factor) * known])
    expected, _ = scipy.optimize.nnls(rows, np.concatenate([measured, np.zeros(7)]))
    assert_allclose(found.volume.ravel(), expected, atol=1e-4)
    assert found.settings["strength"] == 0.05


def test_a_proximal_prior(noisy):
    projector, matrix, measured = noisy
    found = solvers.proximal_gradient(
        projector, measured, prior=Sum(), strength=0.05, iterations=3000
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


def test_named_methods_are_combinations(noisy):
    projector, _, measured = noisy
    pairs = [
        (solvers.nnls, solvers.projected_cg, {}),
        (solvers.tikhonov, solvers.projected_cg, {"prior": Gradient(projector.active)}),
        (solvers.tv, solvers.proximal_gradient, {"prior": TotalVariation(projector.active)}),
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
