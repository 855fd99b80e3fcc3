"""Voxels and effects in one problem: an exact adjoint, and the least sum of squares."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.sparse.linalg import aslinearoperator

from tomo.inference.joint import FrameProblem, Joint, Unknowns
from tomo.priors import RelativeCurvature

FRAMES, VIEWS, VOXELS, AROUND, OWN, SHARED, NODES = 2, 3, 24, 5, 2, 1, 7
PTR = np.array([0, 30, 50, 90])


def random_unknowns(random, joint):
    one = joint.frames[0]
    return Unknowns(
        random.normal(size=(FRAMES, one.operator.shape[1])),
        random.normal(size=(FRAMES, one.outside.shape[1])),
        random.normal(size=(OWN, VIEWS)),
        random.normal(size=SHARED),
        random.normal(size=NODES),
    )


@pytest.fixture
def random():
    return np.random.default_rng(4)


@pytest.fixture
def joint(random, projector_of):
    """Return two frames, each with its weights, prior and columns, that share their operators."""
    pixels = PTR[-1]
    sparse = random.random((pixels, VOXELS)) * (random.random((pixels, VOXELS)) < 0.4)
    A, B = projector_of(sparse, PTR), projector_of(random.random((pixels, AROUND)), PTR)
    frames = [
        FrameProblem(
            A,
            random.uniform(0.5, 2, pixels),
            RelativeCurvature(A.active, random.uniform(0.5, 1, VOXELS).astype(np.float32)),
            strength,
            random.normal(size=(OWN, pixels)),
            random.normal(size=(SHARED, pixels)),
            B,
            0.3,
            aslinearoperator(-random.random((pixels, NODES))),
        )
        for strength in (0.05, 0.2)
    ]
    departure = random.normal(size=(OWN, VIEWS)), random.normal(size=SHARED)
    return Joint(frames, departure, np.full(NODES, 3.0))


def test_the_adjoint_is_that_of_the_prediction(joint, random):
    z, pixels = random_unknowns(random, joint), random.normal(size=(FRAMES, PTR[-1]))
    forward, adjoint = joint.forward(z), joint.adjoint(pixels)
    scale = np.linalg.norm(forward) * np.linalg.norm(pixels)
    assert abs(np.vdot(forward, pixels) - z.dot(adjoint)) < 1e-6 * scale


def stacked(joint, b):
    """Return the whole problem as a dense matrix and a right side, built entry by entry."""
    n, m = (FRAMES * one.shape[1] for one in (joint.frames[0].operator, joint.frames[0].outside))
    size = n + m + OWN * VIEWS + SHARED + NODES

    def of(vector):
        x, o, own, shared, nodes = np.split(vector, np.cumsum([n, m, OWN * VIEWS, SHARED]))
        both = (each.reshape(FRAMES, -1) for each in (x, o))
        return Unknowns(*both, own.reshape(OWN, VIEWS), shared, nodes)

    def rows(z):
        found = []
        for one, image, x, o in zip(
            joint.frames, joint.forward(z), z.voxels, z.outside, strict=True
        ):
            found.append(np.sqrt(one.weights) * image)
            found.append(np.sqrt(one.strength) * one.prior.forward(x.astype(np.float32)))
            found.append(np.sqrt(one.outside_strength) * o)
        return np.concatenate([*found, z.own.ravel(), z.shared])

    matrix = np.stack([rows(of(e)) for e in np.eye(size)], axis=1)
    departure = np.r_[joint.departure[0].ravel(), joint.departure[1]]
    right, each = np.zeros(len(matrix)), (len(matrix) - len(departure)) // FRAMES
    for number, (one, own) in enumerate(zip(joint.frames, b, strict=True)):
        right[number * each : number * each + len(own)] = np.sqrt(one.weights) * own
    right[-len(departure) :] = -departure
    pull = np.r_[np.zeros(size - NODES), joint.pull]
    right -= matrix @ np.linalg.solve(matrix.T @ matrix, pull)  # adds twice the pull times z
    least = np.r_[np.zeros(n + m), np.full(len(departure), -np.inf), np.zeros(NODES)]
    return matrix, right, least, of


def test_the_solution_is_that_of_the_stacked_problem(joint, random):
    truth = random_unknowns(random, joint)
    b = joint.forward(Unknowns(*(np.maximum(one, 0) for one in truth)))
    b = b + 0.5 * random.normal(size=b.shape)
    matrix, right, least, of = stacked(joint, b)
    expected = of(lsq_linear(matrix, right, (least, np.inf), tol=1e-12).x)
    start = Unknowns(*(np.zeros_like(one) for one in truth))
    z, residual = joint.solve(b, start, 300)
    assert (expected.voxels < 1e-6).any()  # the bound acts
    assert 0 < (expected.nodes < 1e-6).sum() < NODES  # and so does the pull
    for found, one in zip(z, expected, strict=True):
        np.testing.assert_allclose(found, one, atol=2e-4)
    np.testing.assert_allclose(residual, b - joint.forward(z), atol=1e-4)
