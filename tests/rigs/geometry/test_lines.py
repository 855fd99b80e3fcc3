import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import nearest_point


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 9))
def test_lines_through_one_point_meet_there(seed, count):
    random = np.random.default_rng(seed)
    point = random.normal(size=3)
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    positions = point - directions * random.uniform(1, 9, (count, 1))
    found, certainty = nearest_point(positions, directions)
    assert 0 <= certainty <= 2 * count / 3 + 1e-9
    assert np.abs(found - point).max() < 1e-9 / max(certainty, 1e-3)


def test_parallel_lines_give_a_point_beside_the_cameras_and_no_certainty():
    positions = np.array([[0.0, 0, 0], [2.0, 0, 0]])
    found, certainty = nearest_point(positions, np.array([[0.0, 0, 1]] * 2))
    assert found == pytest.approx([1, 0, 0])
    assert certainty == pytest.approx(0, abs=1e-12)
