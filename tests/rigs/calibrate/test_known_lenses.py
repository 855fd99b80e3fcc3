"""Lenses known beforehand: square pixels, a fixed centre, one lens for several cameras."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from rigs.calibrate import calibrate
from rigs.check.lines_of_sight import ray_miss


@pytest.fixture(scope="module")
def alike(simulated_rig):
    """Return cameras that all have one lens, with square pixels and a centre in the middle."""
    simulated = simulated_rig(cameras=3, frames=8, seed=3)
    first = simulated.rig[0]
    K = first.camera_matrix.copy()
    K[1, 1], K[:2, 2] = K[0, 0], (np.array(first.image_size) - 1) / 2
    cameras = (
        replace(camera, camera_matrix=K, distortion=first.distortion) for camera in simulated.rig
    )
    simulated = replace(simulated, rig=replace(simulated.rig, cameras=tuple(cameras)))
    return simulated, simulated.observe(0.2, 5)


PLAIN = {"distortion": "brown4"}  # the true model; terms are chosen for a common lens alone
SQUARE, CENTERED = {"square_pixels": True, **PLAIN}, {"fixed_center": True, **PLAIN}
COMMON = {"common_lens": (("cam00", "cam01", "cam02"),)}


@pytest.fixture(scope="module")
def calibrated(alike):
    """Return a function: the calibration of `alike` with options, made once."""
    return functools.cache(functools.partial(calibrate, alike[1]))


def test_square_pixels_stay_square(calibrated):
    found = calibrated(**SQUARE)
    for camera in found.rig:
        assert camera.camera_matrix[0, 0] == camera.camera_matrix[1, 1]
    assert ("cam00", "fx") in found.parameters
    assert ("cam00", "fy") not in found.parameters


def test_a_fixed_centre_stays_in_the_middle(calibrated):
    found = calibrated(**CENTERED)
    for camera in found.rig:
        middle = (np.array(camera.image_size) - 1) / 2
        np.testing.assert_array_equal(camera.camera_matrix[:2, 2], middle)
    assert not {name for _, name in found.parameters} & {"cx", "cy"}


def test_a_common_lens_is_one(calibrated):
    found = calibrated(**COMMON)
    for camera in found.rig:
        np.testing.assert_array_equal(camera.camera_matrix, found.rig[0].camera_matrix)
        assert camera.distortion == found.rig[0].distortion
    assert len(set(found.terms)) == 1
    assert {camera for camera, name in found.parameters if name == "fx"} == {"cam00"}


def test_what_is_known_makes_rays_more_exact(alike, judged_volume):
    simulated, seen = alike
    points = judged_volume(simulated, count=3)
    free = calibrate(seen, **PLAIN)
    bound = calibrate(
        seen, square_pixels=True, fixed_center=True, common_lens=[simulated.rig.names]
    )
    true = [ray_miss(simulated.rig, each.rig, points) for each in (free, bound)]
    assert true[1] < true[0]
    assert bound.quality.predicted_ray_miss < 0.8 * free.quality.predicted_ray_miss
    assert true[1] < 2 * bound.quality.predicted_ray_miss  # and the prediction holds
    assert bound.noise == pytest.approx(0.2, rel=0.1)


def test_a_camera_with_two_images_borrows_the_lens(alike):
    seen = alike[1]
    few = seen.where((seen.camera != 2) | np.isin(seen.frame, np.unique(seen.frame)[2:6:3]))
    images = int((few.counts()[2] > 0).sum())
    assert images < 3
    with pytest.raises(ValueError, match=f"camera cam02: found {images} images"):
        calibrate(few, **PLAIN)
    found = calibrate(few, common_lens=[("cam01", "cam02")], **PLAIN)
    np.testing.assert_array_equal(found.rig[1].camera_matrix, found.rig[2].camera_matrix)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"common_lens": [("cam00", "left")]}, "found 'left', expected among"),
        ({"common_lens": [("cam00",)]}, "found cam00 alone, expected two or more"),
        ({"common_lens": [("cam00", "cam01"), ("cam01", "cam02")]}, "camera cam01 twice"),
    ],
)
def test_sets_of_cameras_that_cannot_be(alike, options, words):
    with pytest.raises(ValueError, match=words):
        calibrate(alike[1], **options)


def test_images_of_other_sizes_have_other_lenses(alike):
    seen = alike[1]
    larger = replace(seen, image_sizes=((800, 480), *seen.image_sizes[1:]))
    with pytest.raises(ValueError, match="camera cam01: found images of 640x480 pixels, expected"):
        calibrate(larger, common_lens=[("cam00", "cam01")])


def test_lenses_are_given_or_found(alike):
    with pytest.raises(ValueError, match="intrinsics: found square_pixels too"):
        calibrate(alike[1], intrinsics=alike[0].rig, square_pixels=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (SQUARE, "its lens with square pixels does not fit"),
        (CENTERED, "its lens with a fixed centre does not fit"),
        (COMMON, "its lens with a common lens does not"),
    ],
)
def test_what_is_not_so_is_said(simulated_rig, calibrated, options, words):
    simulated = simulated_rig(cameras=3, frames=8, seed=3)
    K = simulated.rig[0].camera_matrix * [[1, 1, 1], [1, 1.02, 1], [1, 1, 1]]
    K[:2, 2] += 80
    other = replace(simulated.rig[0], camera_matrix=K)
    cameras = (other, *simulated.rig.cameras[1:])
    simulated = replace(simulated, rig=replace(simulated.rig, cameras=cameras))
    assert words in calibrate(simulated.observe(0.1, 5), **options).assessment
    assert "does not fit" not in calibrated(**options).assessment
