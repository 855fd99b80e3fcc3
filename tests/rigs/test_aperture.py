"""Rays over a lens' aperture: thin-lens geometry, and the quadrature over the disc."""

import math
from dataclasses import replace

import numpy as np
import pytest

import rigs
from rigs.aperture import Aperture, check_apertures, disc_rule

LENS = rigs.Optics(focal_length=50, f_number=2.8, focus_distance=300)
RIG = rigs.ring(3, distance=300, image_size=(32, 24), footprint=1.0)
CAMERA = replace(RIG[1], optics=LENS)
UV = np.array([[0.0, 0.0], [15.5, 11.5], [31.0, 20.0]])


def over(camera, count=24):
    points = np.broadcast_to(disc_rule(count)[0], (len(UV), count, 2))
    return Aperture.of(camera).rays(camera, *camera.rays(UV), points)


def at_depth(camera, origins, directions, depth):
    """Return where rays pass a plane across the optical axis."""
    start = (origins - camera.position) @ camera.R[2]
    time = (depth - start) / (directions @ camera.R[2])
    return origins + time[..., None] * directions


@pytest.mark.parametrize("count", [4, 16, 36, 64, 100, 256])
def test_full_rules_are_exact_for_polynomials_of_their_degree(count):
    points, weights = disc_rule(count)
    degree = 2 * round(math.sqrt(count)) - 1
    for i in range(0, degree + 1, 2):
        for j in range(0, degree + 1 - i, 2):
            # the mean of x^i y^j over the disc, by gamma functions
            a, b = (i + 1) / 2, (j + 1) / 2
            exact = math.gamma(a) * math.gamma(b) / math.gamma(a + b) / math.pi / ((i + j) / 2 + 1)
            found = weights @ (points[:, 0] ** i * points[:, 1] ** j)
            assert found == pytest.approx(exact, rel=1e-12)
    odd = weights @ (points[:, 0] ** 3 * points[:, 1] ** 2)
    assert abs(odd) < (1e-14 if degree >= 5 else 0.1)


@pytest.mark.parametrize("count", [2, 3, 5, 7, 11, 30, 97])
@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_any_number_of_points_is_a_mean_over_the_disc(count, turn):
    points, weights = disc_rule(count, turn)
    assert len(points) == count
    assert np.hypot(*points.T).max() < 1
    assert weights.min() > 0
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(weights @ points, 0, atol=1e-14)
    if count > 2:
        np.testing.assert_allclose(weights @ points**2, 1 / 4, rtol=1e-12)


def test_rays_leave_the_pupil_and_cross_in_the_plane_in_focus():
    origins, directions = over(CAMERA)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1)
    pupil = (origins - CAMERA.position) @ CAMERA.R.T
    np.testing.assert_allclose(pupil[..., 2], 0, atol=1e-12)
    assert np.hypot(pupil[..., 0], pupil[..., 1]).max() < 50 / 5.6
    crossing = at_depth(CAMERA, origins, directions, 300.0)
    chief = at_depth(CAMERA, *CAMERA.rays(UV), 300.0)
    np.testing.assert_allclose(crossing, np.repeat(chief[:, None], 24, axis=1), atol=1e-10)


@pytest.mark.parametrize("depth", [270.0, 330.0, 600.0])
def test_rays_cover_the_circle_of_confusion(depth):
    points = at_depth(CAMERA, *over(CAMERA, 2000), depth)
    chief = at_depth(CAMERA, *CAMERA.rays(UV), depth)[:, None]
    radius = np.linalg.norm(points - chief, axis=-1).max(axis=1)
    expected = 50 / 2.8 * abs(1 - depth / 300)
    np.testing.assert_allclose(2 * radius, expected, rtol=2e-3)
    assert Aperture.of(CAMERA).blur(depth) == pytest.approx(expected)


def test_a_table_whose_rays_start_further_ahead_has_the_same_rays():
    table = rigs.RayTable.of(CAMERA)
    ahead = rigs.RayTable(
        "cam", table.origins + 40 * table.directions, table.directions, optics=LENS
    )
    origins, directions = over(ahead)
    own = at_depth(CAMERA, origins, directions, 0.0)
    np.testing.assert_allclose(own, over(CAMERA)[0], atol=1e-4)  # of the nearest pinhole
    start = (origins - CAMERA.position) @ CAMERA.R[2]
    expected = (ahead.rays(UV)[0] - CAMERA.position) @ CAMERA.R[2]
    np.testing.assert_allclose(start, np.repeat(expected[:, None], 24, axis=1), atol=1e-6)


@pytest.mark.parametrize(
    ("optics", "message"),
    [
        (None, "found no focal_length, f_number, focus_distance, exp"),
        (
            rigs.Optics(focal_length=50, focus_distance=300),
            "camera cam01: optics: found no f_number, expected all three for rays over the "
            r"aperture: write optics: {focal_length: 50, f_number: \?, focus_distance: 300} in",
        ),
        (
            rigs.Optics(focal_length=50, f_number=2, focus_distance=0.3),
            "found focal_length 50 with focus_distance 0.3, expected a lens that focuses beyond",
        ),
    ],
)
def test_cameras_without_an_aperture_are_refused_in_one_line(optics, message):
    with pytest.raises(ValueError, match=message) as caught:
        check_apertures([CAMERA, replace(CAMERA, optics=optics)])
    assert "\n" not in str(caught.value)


def test_values_are_checked():
    with pytest.raises(ValueError, match="aperture: radius: found -1"):
        Aperture(-1, 300)
    with pytest.raises(ValueError, match="focus_distance: found inf"):
        Aperture(1, math.inf)
    lens = rigs.Distortion("fisheye", [0, 0, 0, 0])
    wide = replace(CAMERA, distortion=lens, camera_matrix=[[8, 0, 15.5], [0, 8, 11.5], [0, 0, 1]])
    with pytest.raises(ValueError, match="camera cam01: found a pixel that does not look at"):
        over(wide)
