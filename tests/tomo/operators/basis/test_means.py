import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tomo.operators import coefficients_of, voxel_means


def emission(coefficients, points):
    """Linear between voxels' centres, (n, 3) in voxels, and even beyond the outermost."""
    places = np.clip(points, 0, np.array(coefficients.shape) - 1)
    low = np.minimum(places.astype(int), np.array(coefficients.shape) - 2)
    found = np.zeros(len(points))
    for corner in np.ndindex(2, 2, 2):
        weight = np.abs(1 - np.array(corner) - (places - low)).prod(axis=1)
        found += weight * coefficients[tuple((low + corner).T)]
    return found


def test_they_are_the_mean_of_the_emission_within_each_voxel():
    coefficients = np.random.default_rng(0).random((3, 4, 5))
    halves, weights = np.polynomial.legendre.leggauss(3)
    nodes = np.concatenate([halves - 1, halves + 1]) / 4  # exact on each half, where it is linear
    weights = np.tile(weights, 2) / 4
    means = np.zeros(coefficients.shape)
    for index in np.ndindex(coefficients.shape):
        points = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1) + index
        products = np.einsum("i,j,k->ijk", weights, weights, weights)
        means[index] = emission(coefficients, points.reshape(-1, 3)) @ products.ravel()
    np.testing.assert_allclose(voxel_means(coefficients), means, rtol=1e-12)


@given(st.integers(0, 2**32), st.tuples(*[st.integers(1, 9)] * 3))
def test_coefficients_undo_voxel_means(seed, shape):
    volume = np.random.default_rng(seed).standard_normal(shape)
    np.testing.assert_allclose(voxel_means(coefficients_of(volume)), volume, atol=1e-12)
    np.testing.assert_allclose(coefficients_of(voxel_means(volume)), volume, atol=1e-12)


def test_both_are_symmetric():
    shape = (2, 3, 4)
    for of in (voxel_means, coefficients_of):
        columns = [of(one.reshape(shape)).ravel() for one in np.eye(24)]
        np.testing.assert_allclose(columns, np.transpose(columns), atol=1e-14)


def test_an_even_volume_and_the_sum_of_all_stay():
    coefficients = np.random.default_rng(1).random((5, 6, 7))
    assert voxel_means(coefficients).sum() == pytest.approx(coefficients.sum(), rel=1e-13)
    np.testing.assert_allclose(voxel_means(np.ones((4, 3, 2))), 1, rtol=1e-14)


def test_single_precision_stays():
    assert voxel_means(np.ones((2, 2, 2), np.float32)).dtype == np.float32
