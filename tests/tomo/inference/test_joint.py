"""Voxels and effects in one problem: an exact adjoint, and the least sum of squares."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from tomo.inference.joint import Joint, Unknowns
from tomo.priors import RelativeCurvature

VIEWS, VOXELS, AROUND, OWN, SHARED = 3, 24, 5, 2, 1
PTR = np.array([0, 30, 50, 90])


def random_unknowns(random, joint):
    return Unknowns(
        random.normal(size=joint.operator.shape[1]),
        random.normal(size=joint.outside.shape[1]),
        random.normal(size=(OWN, VIEWS)),
        random.normal(size=SHARED),
    )


@pytest.fixture
def random():
    return np.random.default_rng(4)


@pytest.fixture
def joint(random, projector_of):
    pixels = PTR[-1]
    sparse = random.random((pixels, VOXELS)) * (random.random((pixels, VOXELS)) < 0.4)
    A = projector_of(sparse, PTR)
    return Joint(
        A,
        random.uniform(0.5, 2, pixels),
        RelativeCurvature(A.active, random.uniform(0.5, 1, VOXELS).astype(np.float32)),
        0.05,
        random.normal(size=(OWN, pixels)),
        random.normal(size=(SHARED, pixels)),
        (random.normal(size=(OWN, VIEWS)), random.normal(size=SHARED)),
        projector_of(random.random((pixels, AROUND)), PTR),
        0.3,
    )


def test_the_adjoint_is_that_of_the_prediction(joint, random):
    z, pixels = random_unknowns(random, joint), random.normal(size=PTR[-1])
    forward, adjoint = joint.forward(z), joint.adjoint(pixels)
    scale = np.linalg.norm(forward) * np.linalg.norm(pixels)
    assert abs(forward @ pixels - z.dot(adjoint)) < 1e-6 * scale


def stacked(joint, b):
    """Return the whole problem as a dense matrix and a right side, built entry by entry."""
    n, m = joint.operator.shape[1], joint.outside.shape[1]
    size = n + m + OWN * VIEWS + SHARED

    def of(vector):
        x, o, own, shared = np.split(vector, np.cumsum([n, m, OWN * VIEWS]))
        return Unknowns(x, o, own.reshape(OWN, VIEWS), shared)

    def rows(z):
        parameters = np.r_[z.own.ravel(), z.shared]
        return np.r_[
            np.sqrt(joint.weights) * joint.forward(z),
            np.sqrt(joint.strength) * joint.prior.forward(z.voxels.astype(np.float32)),
            np.sqrt(joint.outside_strength) * z.outside,
            parameters,
        ]

    matrix = np.stack([rows(of(e)) for e in np.eye(size)], axis=1)
    departure = np.r_[joint.departure[0].ravel(), joint.departure[1]]
    right = np.zeros(len(matrix))
    right[: len(b)] = np.sqrt(joint.weights) * b
    right[-len(departure) :] = -departure
    least = np.r_[np.zeros(n + m), np.full(len(departure), -np.inf)]
    return matrix, right, least, of


def test_the_solution_is_that_of_the_stacked_problem(joint, random):
    truth = random_unknowns(random, joint)
    b = joint.forward(truth._replace(voxels=np.maximum(truth.voxels, 0)))
    b = b + 0.5 * random.normal(size=len(b))
    matrix, right, least, of = stacked(joint, b)
    expected = of(lsq_linear(matrix, right, (least, np.inf), tol=1e-12).x)
    start = Unknowns(*(np.zeros_like(one) for one in truth))
    z, residual = joint.solve(b, start, 300)
    assert (expected.voxels < 1e-6).any()  # the bound acts
    for found, one in zip(z, expected, strict=True):
        np.testing.assert_allclose(found, one, atol=2e-4)
    np.testing.assert_allclose(residual, b - joint.forward(z), atol=1e-4)
