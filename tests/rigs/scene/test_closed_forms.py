"""The closed forms agree with the laws they follow from: Snell, Fermat, the ray equation."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from . import closed_forms as forms

QUARTZ = 1.4585


def snell_residual(before, after, normals, n_before, n_after):
    """Return the largest jump of ``n d`` along a surface, and whether all rays go on."""
    jump = np.cross(n_before * before - n_after * after, normals)
    onwards = np.sign((before * normals).sum(axis=1)) == np.sign((after * normals).sum(axis=1))
    return np.abs(jump).max(), onwards.all()


@pytest.mark.parametrize("angle", [1e-3, 0.3, math.radians(30), 1.2])
def test_the_plates_shift_takes_the_least_time(angle):
    thickness, shift = 10.0, forms.plate_shift(10.0, angle, QUARTZ)
    # the ray comes from (-5 tan a, -5), enters at the origin and goes on to the depth 20
    out = thickness * math.tan(angle) - shift / math.cos(angle)
    start = np.array([-5 * math.tan(angle), -5.0])
    end = np.array([out + (20 - thickness) * math.tan(angle), 20.0])

    def time(crossings):
        first, second = np.array([crossings[0], 0.0]), np.array([crossings[1], thickness])
        legs = [np.linalg.norm(first - start), np.linalg.norm(second - first)]
        return legs[0] + QUARTZ * legs[1] + np.linalg.norm(end - second)

    for aside in 1e-4 * np.eye(2):
        here, beside = time([0, out]), [time([0, out] + sign * aside) for sign in (-1, 1)]
        assert abs(beside[1] - beside[0]) / 2e-4 < 1e-9  # a shift 1e-7 longer gives 1e-8
        assert min(beside) > here


def test_rays_behind_a_plate_are_shifted_by_the_formula_in_the_plane_of_incidence():
    random = np.random.default_rng(1)
    normal = np.array([0.2, -0.3, 1.0])
    directions = random.normal(size=(50, 3)) * [0.4, 0.4, 0.1] + [0, 0, 1]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = random.normal(size=(50, 3))
    moved = forms.behind_plate(origins, directions, normal, 10.0, QUARTZ) - origins
    across = moved - (moved * directions).sum(axis=1, keepdims=True) * directions
    cosine = directions @ normal / np.linalg.norm(normal)
    expected = forms.plate_shift(10.0, np.arccos(cosine), QUARTZ)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), expected, rtol=1e-12)
    out_of_plane = (across * np.cross(directions, normal)).sum(axis=1)
    np.testing.assert_allclose(out_of_plane, 0, atol=1e-13)
    turned = forms.behind_plate(origins, directions, -normal, 10.0, QUARTZ)
    np.testing.assert_allclose(turned - origins, moved, atol=1e-13)


@pytest.mark.parametrize("incidence", [0.5, 0.7, 1.1])
def test_a_prism_turns_rays_by_snell_at_both_faces(incidence):
    apex = math.radians(60)
    inside = math.asin(math.sin(incidence) / QUARTZ)
    leaving = brentq(lambda x: math.sin(x) - QUARTZ * math.sin(apex - inside), -1.57, 1.57)
    found = forms.prism_deviation(apex, incidence, QUARTZ)
    assert found == pytest.approx(incidence + leaving - apex, abs=1e-12)


def test_a_prism_turns_least_where_the_way_is_symmetric():
    apex, least = 0.6, forms.least_prism_deviation(0.6, QUARTZ)
    symmetric = (least + apex) / 2
    assert forms.prism_deviation(apex, symmetric, QUARTZ) == pytest.approx(least, abs=1e-12)
    around = forms.prism_deviation(apex, symmetric + np.array([-0.1, 0.1]), QUARTZ)
    assert (around > least + 1e-3).all()
    assert np.isnan(forms.prism_deviation(math.radians(100), 0.5, QUARTZ))


def test_a_ball_focuses_paraxial_rays_at_its_focal_length_and_others_nearer():
    focus = forms.ball_focus(8.0, QUARTZ)
    heights = np.array([1e-4, 1.0, 2.0, 3.0])
    crossings = forms.ball_crossing(heights, 8.0, QUARTZ)
    assert crossings[0] == pytest.approx(focus, rel=1e-8)
    assert (np.diff(crossings) < 0).all()
    below = focus - forms.ball_crossing(np.array([0.1, 0.2]), 8.0, QUARTZ)
    assert below[1] / below[0] == pytest.approx(4, rel=1e-2)  # spherical aberration


TUBES = [
    ([20.0, 17.0], [1.0, QUARTZ, 1.0]),
    ([20.0, 17.0], [1.0, QUARTZ, 1.333]),
    ([20.0, 18.0, 15.0], [1.333, 1.49, 1.2, 1.6]),
    ([20.0], [1.0, QUARTZ]),
]


@pytest.mark.parametrize(("radii", "indices"), TUBES)
@pytest.mark.parametrize("start", [(-60, 3, 1), (-60, -9, 4), (5, 70, -2), (-60, 0, 0)])
def test_a_path_through_a_tube_obeys_snell_at_every_wall(radii, indices, start):
    target = np.array([0.5, 2.0, 20.0])
    direction = (target - start) / np.linalg.norm(target - start)
    points, directions = forms.tube_path(start, direction, radii, indices)
    walls = [*range(len(radii)), *reversed(range(len(radii)))]
    layers = [*range(len(indices)), *reversed(range(len(indices) - 1))]
    assert len(points) == 2 * len(radii)
    np.testing.assert_allclose(np.hypot(*points.T[:2]), np.array(radii)[walls], rtol=1e-12)
    before = np.vstack([direction, directions[:-1]])
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
    legs = np.diff(np.vstack([start, points]), axis=0)
    legs /= np.linalg.norm(legs, axis=1, keepdims=True)
    np.testing.assert_allclose(legs, before, atol=1e-12)  # a piece leads to the next point
    normals = points * [1, 1, 0] / np.hypot(*points.T[:2])[:, None]
    n = np.array(indices)[layers]
    for k in range(len(points)):
        one = slice(k, k + 1)
        residual, onwards = snell_residual(
            before[one], directions[one], normals[one], n[k], n[k + 1]
        )
        assert residual < 1e-12
        assert onwards


def test_a_ray_that_only_grazes_the_wall_passes_no_bore():
    points, _ = forms.tube_path((-60, 19, 0), (1, 0, 0), [20.0, 10.0], [1, QUARTZ, 1])
    assert len(points) == 2
    with pytest.raises(ValueError, match="total reflection"):
        forms.tube_path((-60, 12, 0), (1, 0, 0), [20.0, 10.0], [1, QUARTZ, 1])
    with pytest.raises(ValueError, match="misses"):
        forms.tube_path((-60, 20, 0), (1, 0, 0), [20.0, 10.0], [1, QUARTZ, 1])


def test_the_way_by_a_mirror_is_as_long_as_the_straight_way_from_the_image():
    point, normal = np.array([1.0, 2.0, 3.0]), np.array([0.3, -1.0, 0.5])
    camera, target = np.array([[4.0, -2.0, 1.0]]), np.array([[-1.0, -5.0, 3.0]])  # in front of it
    virtual = forms.mirror_image(camera, point, normal)
    np.testing.assert_allclose(forms.mirror_image(virtual, point, normal), camera, atol=1e-12)
    direction = target - virtual
    reach = ((point - virtual) @ normal) / (direction @ normal)
    hit = virtual + reach[:, None] * direction
    way = np.linalg.norm(hit - camera) + np.linalg.norm(target - hit)
    assert reach.item() * np.linalg.norm(direction) + np.linalg.norm(target - hit) == (
        pytest.approx(way, rel=1e-12)
    )
    coming = forms.mirrored_directions(direction, normal)
    np.testing.assert_allclose(np.cross(coming, hit - camera), 0, atol=1e-10)


def ray_equation_residual(path, square, half_slope, sigma):
    """Return how far ``|x'| - n`` and ``x'' - ∇n² / 2`` are from 0, by central differences."""
    step = 1e-4
    before, here, after = (path(sigma + shift)[0] for shift in (-step, 0, step))
    speed, bend = (after - before) / (2 * step), (after - 2 * here + before) / step**2
    unit = speed / np.linalg.norm(speed, axis=1, keepdims=True)
    np.testing.assert_allclose(path(sigma)[1], unit, atol=1e-8)
    return (
        np.abs(np.linalg.norm(speed, axis=1) - np.sqrt(square(here))).max(),
        np.abs(bend - half_slope(here)).max(),
    )


def test_the_path_in_a_linear_gradient_is_a_parabola_of_the_ray_equation():
    origin, direction = np.array([1.0, -2.0, 0.5]), np.array([0.6, 0.0, 0.8])
    gradient = np.array([0.02, 0.03, -0.01])
    residual = ray_equation_residual(
        lambda sigma: forms.gradient_path(origin, direction, 1.3, gradient, sigma),
        lambda x: 1.3**2 + 2 * (x - origin) @ gradient,
        lambda x: np.broadcast_to(gradient, x.shape),
        np.linspace(0, 5, 7),
    )
    assert max(residual) < 1e-6
    points, _ = forms.gradient_path(origin, direction, 1.3, gradient, np.linspace(0, 5, 7))
    third = np.diff(points, n=3, axis=0)
    assert np.abs(third).max() < 1e-12


def test_luneburgs_lens_brings_parallel_rays_to_its_far_point_at_the_same_time():
    direction, times = np.array([0.0, 0.6, 0.8]), []
    side, up = np.array([1.0, 0, 0]), np.array([0.0, 0.8, -0.6])
    for right, high in [(0, 0), (0.5, 0.2), (-0.9, 0.1), (0.3, -0.8)]:
        back = math.sqrt(1 - right**2 - high**2)
        origin = right * side + high * up - back * direction

        def path(sigma, origin=origin):
            return forms.luneburg_path(origin, direction, sigma)

        residual = ray_equation_residual(
            path, lambda x: 2 - np.square(x).sum(axis=1), lambda x: -x, np.linspace(0.1, 1.5, 5)
        )
        assert max(residual) < 1e-6
        np.testing.assert_allclose(path([math.pi / 2])[0][0], direction, atol=1e-15)
        nodes, weights = np.polynomial.legendre.leggauss(12)
        points, _ = path((nodes + 1) * math.pi / 4)
        inside = (weights * (2 - np.square(points).sum(axis=1))).sum() * math.pi / 4  # ∫ n² dσ
        times.append(inside - back)  # from the plane through the middle
    np.testing.assert_allclose(times, times[0], atol=1e-12)


def test_what_passes_a_surface():
    assert forms.fresnel_transmission(0.0, 1.0, QUARTZ) == pytest.approx(4 * QUARTZ / 2.4585**2)
    assert forms.fresnel_transmission(1e-4, 1.0, QUARTZ) == pytest.approx(
        forms.fresnel_transmission(0.0, 1.0, QUARTZ), abs=1e-7
    )
    brewster = math.atan(QUARTZ)  # half of the light is reflected by (sin(a - b))² alone
    apart = brewster - math.asin(math.sin(brewster) / QUARTZ)
    found = forms.fresnel_transmission(brewster, 1.0, QUARTZ)
    assert found == pytest.approx(1 - math.sin(apart) ** 2 / 2, abs=1e-12)
    angles = np.linspace(0, 1.5, 9)
    inside = np.arcsin(np.sin(angles) / QUARTZ)
    np.testing.assert_allclose(  # the way back
        forms.fresnel_transmission(inside, QUARTZ, 1.0),
        forms.fresnel_transmission(angles, 1.0, QUARTZ),
        atol=1e-9,
    )
    assert forms.fresnel_transmission(0.9, QUARTZ, 1.0) == 0


def test_a_lens_out_of_focus_sees_the_cone_of_its_aperture():
    edge = np.array([50 / 2.8 / 2, 0.0])
    for depth in (270.0, 330.0):
        line = edge + (np.array([0.0, 300.0]) - edge) * depth / 300
        assert forms.defocus_disc(50.0, 2.8, 300.0, depth) == pytest.approx(2 * abs(line[0]))
