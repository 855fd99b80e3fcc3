import itertools

import numpy as np
import pytest

from rigs.check.angular_gap import angles_between, largest_gap, lines_of_sight, new_view


def ring_lines(degrees):
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)


def by_all_cells(lines):
    """Return the gap from every vertex of the cells between the planes across the lines."""
    tried = [*lines]
    for i, j in itertools.combinations(range(len(lines)), 2):
        tried += [lines[i] + lines[j], lines[i] - lines[j]]
    for i, j, k in itertools.combinations(range(len(lines)), 3):
        for s, q in itertools.product((1, -1), repeat=2):
            tried.append(np.cross(lines[i] - s * lines[j], lines[i] - q * lines[k]))
    tried = np.array(tried)
    length = np.linalg.norm(tried, axis=1)
    tried = tried[length > 1e-9] / length[length > 1e-9, None]
    sine = np.abs(tried @ lines.T).min(axis=1).max()
    return 2 * np.degrees(np.arcsin(min(sine, 1.0)))


@pytest.mark.parametrize("count", [1, 2, 3, 7, 12, 33])
def test_even_half_ring_leaves_a_straight_angle_over_its_number(count):
    gap, normal = largest_gap(ring_lines(180 * np.arange(count) / count)[None])
    assert gap[0] == pytest.approx(180 / count, abs=1e-6)
    assert abs(normal[0, 1]) < 1e-6 or count == 1


def test_full_ring_of_an_even_number_sees_half_of_it_twice():
    assert largest_gap(ring_lines(30.0 * np.arange(12))[None])[0][0] == pytest.approx(30)
    assert largest_gap(ring_lines(360 / 11 * np.arange(11))[None])[0][0] == pytest.approx(180 / 11)


def test_arc_leaves_what_it_does_not_span():
    assert largest_gap(ring_lines([-60, -30, 0, 30, 60])[None])[0][0] == pytest.approx(60)
    assert largest_gap(ring_lines([0, 10, 20])[None])[0][0] == pytest.approx(160)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 8, 12])
def test_any_directions_against_every_cell(count):
    rng = np.random.default_rng(count)
    lines = rng.normal(size=(15, count, 3))
    lines /= np.linalg.norm(lines, axis=2, keepdims=True)
    np.testing.assert_allclose(largest_gap(lines)[0], [by_all_cells(d) for d in lines], atol=1e-6)


def test_only_the_views_that_see_count_and_none_leaves_everything_open():
    lines = np.tile(ring_lines([0, 45, 90, 135]), (3, 1, 1))
    seen = np.array([[1, 1, 1, 1], [1, 0, 1, 0], [0, 0, 0, 0]], bool)
    gap, normal = largest_gap(lines, seen)
    np.testing.assert_allclose(gap, [45, 90, 180])
    assert np.isnan(normal[2]).all()


def test_turning_the_world_turns_nothing_of_the_gap():
    rng = np.random.default_rng(3)
    lines = rng.normal(size=(1, 9, 3))
    lines /= np.linalg.norm(lines, axis=2, keepdims=True)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    flips = np.where(rng.uniform(size=(9, 1)) < 0.5, -1, 1)
    assert largest_gap(flips * lines @ turn.T)[0] == pytest.approx(largest_gap(lines)[0])


def test_the_new_view_closes_the_gap():
    lines = ring_lines([0, 20, 40, 60, 80])
    gap, normal = largest_gap(lines[None])
    assert gap[0] == pytest.approx(100)
    way = new_view(normal[0], lines)
    np.testing.assert_allclose(np.abs(way), np.abs(ring_lines([130])[0]), atol=1e-6)
    assert largest_gap(np.vstack([lines, way])[None])[0][0] == pytest.approx(50)


def test_angles_between_lines_are_modulo_a_straight_angle_and_fine():
    angles = angles_between(ring_lines([0, 1e-5, 180, 90]))
    np.testing.assert_allclose(angles[0, 1:], [1e-5, 0, 90], atol=1e-9)
    assert np.isinf(np.diag(angles)).all()


def test_a_wrong_shape_is_reported():
    with pytest.raises(ValueError, match=r"directions: found shape \(4, 3\)"):
        largest_gap(np.zeros((4, 3)))


def test_views_from_both_ends_of_a_line_count_once():
    angles = np.radians([0.0, 60.0, 120.0, 180.0, 243.0, 300.0])  # 63 is 3 degrees off 60
    ring = np.stack([np.cos(angles), np.zeros(6), np.sin(angles)], axis=-1)
    seen = np.ones((3, 6), bool)
    seen[1, 3] = False  # its line is seen from the other end
    seen[2, :3] = False
    directions = np.stack([ring] * 3)
    assert lines_of_sight(directions, seen, 5.0).tolist() == [3, 3, 3]
    assert lines_of_sight(directions, seen, 2.0).tolist() == [4, 4, 3]
    assert lines_of_sight(-directions, seen, 2.0).tolist() == [4, 4, 3]
    assert lines_of_sight(directions, np.zeros((3, 6), bool), 5.0).tolist() == [0, 0, 0]
