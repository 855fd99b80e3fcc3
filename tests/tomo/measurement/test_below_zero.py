"""Images with too much subtracted as dark are reported; noise, however strong, is not."""

import numpy as np
import pytest

import phantoms
import rigs
from tomo import VoxelGrid
from tomo.measurement import below_zero, estimate_noise
from tomo.measurement.pixel_check import check_pixels
from tomo.pipeline.findings import findings_of_pixels
from tomo.simulation import camera_noise, simulate_images

ROWS, COLUMNS = np.mgrid[0:60, 0:50]
BLOB = np.exp(-(((ROWS - 30) / 12) ** 2) - ((COLUMNS - 25) / 8) ** 2).astype(np.float32)
ALL = np.ones(BLOB.shape, bool)


def depth(image, mask=ALL):
    return below_zero(image, mask, estimate_noise(image, mask))


@pytest.mark.parametrize("sigma", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("seed", range(5))
def test_what_was_subtracted_is_found_under_noise(sigma, seed):
    noisy = camera_noise.gaussian(BLOB, sigma, np.random.default_rng(seed))
    assert depth(noisy) == 0
    assert depth(noisy - 0.15) == pytest.approx(0.15, abs=0.02)


def test_the_unit_of_the_images_does_not_matter():
    noisy = camera_noise.gaussian(BLOB, 0.02, np.random.default_rng(0)) - np.float32(0.1)
    for unit in (1e-20, 1e20):
        assert depth(noisy * unit) == pytest.approx(unit * depth(noisy), rel=1e-3)


def test_single_pixels_and_those_that_are_masked_say_nothing():
    image = BLOB.copy()
    image[5, 5] = -3.0
    image[12:32, 4:8] = np.nan
    mask = np.isfinite(image)
    assert depth(image, mask) == 0
    image[~mask] = -5.0
    assert depth(image, mask) == 0
    assert depth(image) == pytest.approx(5)
    assert depth(image, np.zeros_like(mask)) == 0
    assert depth(np.zeros((2, 3)), np.ones((2, 3), bool)) == 0


def test_cameras_with_dark_regions_below_zero_are_found():
    grid = VoxelGrid((10, 20, 10), 1.0)
    rig = rigs.ring(4, distance=200.0, image_size=(40, 60), footprint=0.5)
    images = list(
        simulate_images(rig, phantoms.create("jet", 1, grid.extent), grid).images.values()
    )
    masks = [np.ones(image.shape, bool) for image in images]
    found = check_pixels(rig.names, images, masks)
    assert found.below_zero == {}
    brightest = max(float(image.max()) for image in images)
    images[1], images[3] = images[1] - 0.02 * brightest, images[3] - 0.05 * brightest
    found = check_pixels(rig.names, images, masks)
    assert found.report()["below_zero"] == pytest.approx(
        {"cam01": 0.02 * brightest, "cam03": 0.05 * brightest}, rel=0.02
    )
    said = findings_of_pixels(found, images, [])
    assert [(one.effect, one.camera, one.corrected) for one in said] == [
        ("below zero", "cam01", False),
        ("below zero", "cam03", False),
    ]
    assert said[1].size == pytest.approx(0.05, rel=0.1)
