import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import Camera, Rig, arc, look_at, nearest_point, point_in_view, ring


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


@pytest.mark.parametrize("center", [(0, 0, 0), (1e4, -2.0, 3.5)])
def test_where_a_rig_looks(center):
    rig = ring(4, 40.0, 800.0, image_size=(30, 20), footprint=1.0, center=center)
    np.testing.assert_allclose(point_in_view(rig), center, atol=1e-3)


def test_where_no_middle_rays_meet():
    assert point_in_view(ring(1, distance=150.0, image_size=(48, 64), footprint=0.5)) is None
    assert point_in_view(Rig(())) is None
    K = np.array([[100.0, 0, 9.5], [0, 100, 9.5], [0, 0, 1]])
    outward = []
    for number, place in enumerate(np.eye(3) * 50):  # three walls of a box, facing askew
        R, t = look_at(place, place + np.roll(place, 1), (1, 1, 1))
        outward.append(Camera(f"cam{number}", (20, 20), K, R=R, t=t))
    assert point_in_view(Rig(tuple(outward))) is None


def test_an_arc_looks_at_its_center():
    rig = arc(5, 30.0, 500.0, image_size=(20, 20), footprint=1.0, center=(1.0, 2.0, 3.0))
    np.testing.assert_allclose(point_in_view(rig), (1, 2, 3), atol=1e-3)
