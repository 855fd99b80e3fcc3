"""Light from outside the grid is reported; noise, blur and dark images are not taken for it."""

import numpy as np
import pytest

import phantoms
import rigs
from tomo import VoxelGrid
from tomo.measurement import estimate_noise
from tomo.screening import light_outside, screen_images
from tomo.simulation import camera_noise, simulate_images

GRID = VoxelGrid((20, 40, 20), 1.0, (2.0, -1.0, 0.5))


@pytest.fixture(scope="module")
def seen():
    rig = rigs.ring(
        5,
        distance=200.0,
        image_size=(90, 110),
        footprint=0.5,
        pitch_degrees=15,
        center=GRID.center,
    )
    field = phantoms.create("jet", 1, GRID.extent, GRID.center)
    return rig, list(simulate_images(rig, field, GRID).images.values())


def shares(rig, images, grid, masks=None):
    masks = masks or [np.ones(image.shape, bool) for image in images]
    noises = [estimate_noise(i, m) for i, m in zip(images, masks, strict=True)]
    return light_outside(list(rig), images, masks, noises, grid)


@pytest.mark.parametrize("sigma", [0.0, 0.02, 0.1])
def test_what_the_grid_holds_is_not_beside_it(seen, sigma):
    rig, images = seen
    noisy = [
        camera_noise.gaussian(i, sigma, np.random.default_rng(k)) for k, i in enumerate(images)
    ]
    assert shares(rig, noisy, GRID) == [0.0] * 5


def test_the_share_is_that_of_the_pixels_that_miss_the_grid(seen):
    rig, images = seen
    half = VoxelGrid((20, 20, 20), 1.0, (2.0, 9.0, 0.5))  # the upper half
    found = shares(rig, images, half)
    for camera, image, share in zip(rig, images, found, strict=True):
        rows = camera.project(half.centers().reshape(-1, 3))[0][:, 1]
        below = image[int(rows.max()) + 1 :].sum() / image.sum()
        assert 0.5 * below < share < 1.1 * below
        assert share > 0.1


def test_masked_light_dark_images_and_cameras_that_look_away_say_nothing(seen):
    rig, images = seen
    glow = [image.copy() for image in images]
    for image in glow:
        image[:8, :8] = image.max() / 2
    assert min(shares(rig, glow, GRID)) > 0.01
    masks = [np.ones(image.shape, bool) for image in glow]
    for mask in masks:
        mask[:8, :8] = False
    assert shares(rig, glow, GRID, masks) == [0.0] * 5
    assert shares(rig, [0 * image for image in images], GRID) == [0.0] * 5
    assert shares(rig, images, VoxelGrid((4, 4, 4), 1.0, (0, 5000.0, 0))) == [0.0] * 5


def test_small_images_are_judged_too():
    rig = rigs.ring(3, distance=200.0, image_size=(3, 40), footprint=1.0)
    images = [np.ones((40, 3), np.float32)] * 3
    assert shares(rig, images, VoxelGrid((4, 4, 4), 1.0)) == [0.0] * 3


def test_too_small_a_grid_is_reported_before_all_else(seen):
    rig, images = seen
    masks = [np.ones(image.shape, bool) for image in images]
    assert screen_images(rig, images, masks, GRID).warnings == []
    low = VoxelGrid((20, 28, 20), 1.0, (2.0, 5.0, 0.5))
    found = screen_images(rig, images, masks, low)
    assert "comes from outside the grid" in found.warnings[0]
    assert found.report()["light_outside_grid"] == found.outside
    assert f"{max(found.outside.values()):.0%}" in found.warnings[0]
