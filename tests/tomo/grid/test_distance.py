"""How far voxels are from the active ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_cdt

from tomo.grid.distance import FARTHEST, clearance

sides = st.tuples(*[st.integers(1, 14)] * 3)


@given(sides, st.integers(0, 2**32 - 1), st.floats(0.001, 0.5))
def test_it_is_the_chessboard_distance(shape, seed, share):
    active = np.random.default_rng(seed).random(shape) < share
    active.flat[seed % active.size] = True
    expected = distance_transform_cdt(~active, "chessboard")
    np.testing.assert_array_equal(clearance(active), expected)


def test_what_is_farther_than_a_byte_tells_is_told_as_that():
    active = np.zeros((2, 3, 700), np.bool_)
    assert (clearance(active) == FARTHEST).all()
    active[1, 1, 0] = True
    np.testing.assert_array_equal(clearance(active)[0, 0], np.clip(np.arange(700), 1, FARTHEST))
