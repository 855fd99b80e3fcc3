"""The blur of active voxels against scipy's, and what makes it a symmetric operator."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.grid.blur import Blur


@given(
    shape=st.tuples(*[st.integers(1, 9)] * 3),
    width=st.floats(0.2, 4),
    share=st.sampled_from([0.05, 0.4, 1.0]),
    seed=st.integers(0, 99),
)
def test_it_is_scipys_blur_between_live_voxels(shape, width, share, seed):
    random = np.random.default_rng(seed)
    active = ActiveVoxels.from_mask(VoxelGrid(shape, 1.0), random.random(shape) < share)
    values = random.standard_normal(active.size)
    volume = active.expand(values).reshape(shape)
    expected = active.compress(gaussian_filter(volume, width, mode="constant", truncate=3.0))
    np.testing.assert_allclose(Blur(active, width)(values), expected, atol=1e-12)


def test_the_matrix_is_symmetric():
    random = np.random.default_rng(1)
    active = ActiveVoxels.from_mask(VoxelGrid((5, 4, 6), 1.0), random.random((5, 4, 6)) < 0.5)
    blur = Blur(active, 0.9)
    matrix = np.stack([blur(unit) for unit in np.eye(active.size)])
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-15)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_far_from_the_edges_the_total_stays(dtype):
    active = ActiveVoxels(VoxelGrid((21, 21, 21), 1.0))
    one = np.zeros(active.size, dtype)
    one[active.size // 2] = 1
    blurred = Blur(active, 2.0)(one)
    assert blurred.dtype == dtype
    assert blurred.sum(dtype=np.float64) == pytest.approx(1, abs=1e-6)
