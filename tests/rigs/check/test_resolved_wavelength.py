import itertools

import numpy as np
import pytest

from rigs.check.lines_of_sight import angles_between
from rigs.check.resolved_wavelength import (
    ViewsOfObject,
    box_covariance,
    closing_view,
    half_sphere,
    object_length,
)

CUBE = box_covariance((10.0, 10.0, 10.0))


def ring_lines(degrees):
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)


def views(lines, covariance=CUBE, *, voxel=0.01, seen=None, footprint=0.01):
    lines = np.asarray(lines, np.float64)
    lines = lines if lines.ndim == 3 else lines[None]
    seen = np.ones(lines.shape[:2], bool) if seen is None else seen
    return ViewsOfObject(lines, seen, np.full(seen.shape, footprint), covariance, voxel)


def random_lines(count, seed):
    lines = np.random.default_rng(seed).normal(size=(count, 3))
    return lines / np.linalg.norm(lines, axis=1, keepdims=True)


def by_all_cells(lines):
    """Return the largest ``min_i |n . d_i|`` over every vertex of the cells between the planes."""
    tried = [*lines]
    for i, j in itertools.combinations(range(len(lines)), 2):
        tried += [lines[i] + lines[j], lines[i] - lines[j]]
    for i, j, k in itertools.combinations(range(len(lines)), 3):
        for s, q in itertools.product((1, -1), repeat=2):
            tried.append(np.cross(lines[i] - s * lines[j], lines[i] - q * lines[k]))
    tried = np.array(tried)
    length = np.linalg.norm(tried, axis=1)
    tried = tried[length > 1e-9] / length[length > 1e-9, None]
    return np.abs(tried @ lines.T).min(axis=1).max()


def test_a_view_measures_waves_across_it_down_to_the_pixel_and_along_it_as_twice_the_object():
    one = views([[0, 0, 1.0]], footprint=0.3, voxel=0.2)
    slanted = np.array([np.sin(0.1), 0, np.cos(0.1)])
    found = one.wavelengths(np.array([[1.0, 0, 0], [0, 0, 1], slanted]))[0]
    np.testing.assert_allclose(found, [0.6, 20, 20 * np.cos(0.1)])
    coarse_voxels = views([[0, 0, 1.0]], footprint=0.3, voxel=0.8)
    assert coarse_voxels.wavelengths(np.array([[1.0, 0, 0]]))[0, 0] == pytest.approx(0.8)


def test_the_finest_view_counts():
    both = views([[0, 0, 1.0], [1, 0, 0]])
    n = np.array([[0.6, 0, 0.8]])
    assert both.wavelengths(n)[0, 0] == pytest.approx(2 * 0.6 * 10)


def test_the_length_of_a_box_is_its_edge_along_an_axis_and_its_width_aslant():
    covariance = box_covariance((2.0, 5.0, 3.0))
    np.testing.assert_allclose(object_length(np.eye(3), covariance), [2, 5, 3])
    tall = box_covariance((15.0, 70.0, 15.0))
    pitch = np.radians(15.0)
    slanted = np.array([np.cos(pitch), np.sin(pitch), 0])
    assert object_length(slanted, tall) == pytest.approx(15 / np.cos(pitch), rel=0.01)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (100_000, 3)) * (15.0, 70.0, 15.0)
    assert object_length(slanted, np.cov(points.T)) == pytest.approx(15 / np.cos(pitch), rel=0.02)


@pytest.mark.parametrize("count", [2, 3, 7, 12, 33])
def test_an_even_half_ring_has_crowther_s_limit(count):
    found = views(ring_lines(180 * np.arange(count) / count)).resolved()
    assert found.worst == pytest.approx(20 * np.sin(np.pi / 2 / count), rel=1e-3)
    assert abs(found.worst_direction[1]) < 0.02
    if count > 7:
        assert found.worst == pytest.approx(np.pi * 10 / count, rel=0.01)
    assert found.half < found.nine_tenths < found.worst


def test_a_full_ring_of_an_even_number_measures_as_half_of_it():
    whole, half = (views(ring_lines(30.0 * np.arange(n))).resolved() for n in (12, 6))
    for name in ("half", "nine_tenths", "worst"):
        assert getattr(whole, name) == pytest.approx(getattr(half, name))
    odd = views(ring_lines(360 / 11 * np.arange(11))).resolved()
    assert odd.worst == pytest.approx(20 * np.sin(np.pi / 22), rel=1e-3)


def test_an_arc_does_not_measure_what_it_does_not_span():
    found = views(ring_lines([0, 10, 20])).resolved()
    assert found.worst == pytest.approx(20 * np.sin(np.radians(80)), rel=1e-3)
    np.testing.assert_allclose(np.abs(found.worst_direction), np.abs(ring_lines(10)), atol=0.02)
    assert found.is_coarse


@pytest.mark.parametrize(("count", "coarse"), [(2, True), (3, True), (4, False), (9, False)])
def test_three_even_views_leave_details_as_large_as_the_object(count, coarse):
    found = views(ring_lines(180 * np.arange(count) / count)).resolved()
    assert found.of_length == pytest.approx(2 * np.sin(np.pi / 2 / count), rel=0.03)
    assert found.is_coarse == coarse


def test_an_object_of_a_voxel_is_not_called_coarse():
    tiny = views(ring_lines([0.0, 90.0]), box_covariance((1.0, 1, 1)), voxel=1.0)
    assert not tiny.resolved().is_coarse


@pytest.mark.parametrize("count", [2, 3, 4, 5, 8, 12])
def test_the_worst_of_any_directions_against_every_cell(count):
    for seed in range(5):
        lines = random_lines(count, (seed, count))
        worst = views(lines).resolved().worst
        assert worst == pytest.approx(20 * by_all_cells(lines), rel=0.05)


def test_only_the_views_that_see_count():
    lines = np.tile(ring_lines([0, 45, 90, 135]), (3, 1, 1))
    seen = np.array([[1, 1, 1, 1], [1, 0, 1, 0], [0, 0, 0, 0]], bool)
    looking = views(lines, seen=seen)
    few = [looking.at(np.array([point])).resolved().worst for point in range(3)]
    assert few[2] == np.inf
    np.testing.assert_allclose(few[:2], 20 * np.sin(np.radians([22.5, 45])), rtol=1e-3)
    at_points = looking.at_points()
    assert at_points[0] < at_points[1]
    assert np.isnan(at_points[2])
    assert np.isfinite(looking.resolved().worst)  # the point that none sees does not count
    assert "no detail" in looking.at(np.array([2])).resolved().words("mm")


def test_points_weigh_in_the_quantiles_as_they_are_asked_to():
    lines = np.stack([ring_lines([0, 45, 90, 135])] * 2)
    seen = np.array([[1, 1, 1, 1], [1, 0, 1, 0]], bool)
    good, bad = (
        views(lines, seen=seen).resolved(np.array(weights)) for weights in ([9.0, 1], [1.0, 9])
    )
    assert good.half < bad.half


def test_turning_the_world_turns_nothing_but_the_direction():
    lines = random_lines(9, 3)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    flips = np.where(np.random.default_rng(4).uniform(size=(9, 1)) < 0.5, -1, 1)
    one, other = views(lines).resolved(), views(flips * lines @ turn.T).resolved()
    assert other.worst == pytest.approx(one.worst, rel=0.02)
    assert other.half == pytest.approx(one.half, rel=0.05)
    assert other.nine_tenths == pytest.approx(one.nine_tenths, rel=0.05)


def test_the_view_that_matters_is_the_one_whose_loss_costs():
    lines = ring_lines([0, 1, 60, 120])
    grown = views(lines).growth_without()
    assert (grown[2:] > 5 * grown[:2]).all()
    assert np.isinf(views(lines[:1]).growth_without()).all()


def test_the_closing_view_closes_the_gap():
    lines = ring_lines([0, 20, 40, 60, 80])
    found = views(lines).resolved()
    assert found.worst == pytest.approx(20 * np.sin(np.radians(50)), rel=1e-3)
    way = closing_view(found.worst_direction, lines)
    np.testing.assert_allclose(np.abs(way), np.abs(ring_lines(130)), atol=0.02)
    closed = views(np.vstack([lines, way])).resolved()
    assert closed.worst == pytest.approx(20 * np.sin(np.radians(25)), rel=0.03)


def test_directions_cover_the_half_sphere_evenly():
    directions = half_sphere(500)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(directions.T @ directions / 500, np.eye(3) / 3, atol=0.01)


def test_the_words_name_an_axis_or_a_direction():
    resolved = views(ring_lines([-10.0, 0, 10]), voxel=1.0).resolved()
    words = resolved.words("mm")
    assert words.startswith("half of all details down to ")
    assert words.endswith("least: flat layers across z (20 mm)")
    turned = views(ring_lines([35.0, 45, 55]), voxel=1.0).resolved()
    assert "flat layers across (0.7, 0, 0.7)" in turned.words("mm")
    fine = views(ring_lines(np.arange(0, 180, 2.0)), voxel=1.0).resolved()
    assert fine.words("mm") == "all details down to 1 voxel are measured"


def test_angles_between_lines_are_modulo_a_straight_angle_and_fine():
    angles = angles_between(ring_lines([0, 1e-5, 180, 90]))
    np.testing.assert_allclose(angles[0, 1:], [1e-5, 0, 90], atol=1e-9)
    assert np.isinf(np.diag(angles)).all()
