"""What pixels are worth: one over the variance of their noise and of what voxels miss."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tomo.measurement import NoiseModel, estimate_noise, weigh_pixels
from tomo.measurement.pixel_weights import EQUAL, FINER, LEAST_MISSED

HEIGHT, WIDTH = 60, 80
ALL = np.ones((HEIGHT, WIDTH), bool)


def steps(*levels):
    """Return an image of vertical stripes, wide enough for each middle to know no other."""
    return np.repeat(np.float64(levels), WIDTH // len(levels))[None].repeat(HEIGHT, axis=0)


def middles(image, count):
    return image[HEIGHT // 2, WIDTH // count // 2 :: WIDTH // count]


def flame(width):
    across, down = np.meshgrid(np.arange(WIDTH) - WIDTH / 2, np.arange(HEIGHT) - HEIGHT / 2)
    return np.exp(-(across**2 + down**2) / (2 * width**2))


def test_a_weight_is_one_over_the_variance_of_noise_and_of_what_voxels_miss():
    levels = np.array([0.0, 1.0, 4.0, 10.0])
    found = weigh_pixels([steps(*levels)], [ALL], [NoiseModel(0.3, 0.2)], [math.nan])
    variances = 0.3**2 + 0.2 * levels + (LEAST_MISSED * 10) ** 2
    assert_allclose(middles(found.images[0], 4), variances[0] / variances, rtol=1e-6)
    ratio = found.variance_ratio
    assert found.variance_ratio == pytest.approx(variances[3] / variances[0], rel=1e-6)
    assert found.report() == {
        "used": True,
        "reason": f"the noisiest pixels have {ratio:.3g} times the variance of others",
    }


def test_a_noisier_camera_is_worth_less():
    image = steps(1.0, 2.0)
    models = [NoiseModel(0.1), NoiseModel(0.4)]
    found = weigh_pixels([image, image], [ALL, ALL], models, [math.nan] * 2)
    quiet, noisy = ((read**2 + (2 * LEAST_MISSED) ** 2) for read in (0.1, 0.4))
    assert_allclose(found.images[0], 1, rtol=1e-6)
    assert_allclose(found.images[1], quiet / noisy, rtol=1e-6)


@pytest.mark.parametrize("gain", [0.0, 1e-5])
def test_pixels_about_as_noisy_as_each_other_count_alike(gain):
    found = weigh_pixels([steps(0.0, 1.0)], [ALL], [NoiseModel(0.1, gain)], [3.0])
    assert found.images is None
    assert 1 <= found.variance_ratio < EQUAL
    assert not found.report()["used"]


def test_gaussian_noise_is_even_and_that_of_photons_is_not():
    random = np.random.default_rng(3)
    clean = flame(14)
    for images, even in (
        ([clean + random.normal(0, 0.1, clean.shape) for _ in range(8)], True),
        ([random.poisson(200 * clean) / 200 for _ in range(8)], False),
    ):
        models = [estimate_noise(image) for image in images]
        found = weigh_pixels(images, [ALL] * 8, models, [2.0] * 8)
        assert (found.images is None) == even


@pytest.mark.parametrize("depth", [0.05, 0.2])
def test_what_voxels_miss_is_measured_by_what_is_finer_than_them(depth):
    ripples = 1 + depth * np.sqrt(2) * np.cos(np.arange(WIDTH) * np.pi / 2)  # four pixels long
    lit, dark = np.tile(ripples, (HEIGHT, 1)), np.zeros((HEIGHT, WIDTH))
    photons = NoiseModel(0.0, 0.4 * depth**2)  # that much of the ripples may be noise
    found = weigh_pixels([lit, dark], [ALL, ALL], [photons] * 2, [10.0] * 2)
    missed = FINER**2 * 0.6 * depth**2
    assert_allclose(found.images[1], 1)
    assert found.images[0].mean() == pytest.approx(missed / (missed + photons.gain), rel=0.03)


@pytest.mark.parametrize("width", [10, 16])
@pytest.mark.parametrize("across", [1.0, 3.0])
def test_noise_is_not_taken_for_what_voxels_miss(width, across):
    random, photons = np.random.default_rng(7), 300
    images = [random.poisson(photons * flame(width)) / photons for _ in range(4)]
    models = [NoiseModel(0.0, 1 / photons)] * 4
    found, least = (
        weigh_pixels(images, [ALL] * 4, models, [each] * 4).images for each in (across, math.nan)
    )
    assert_allclose(found, least, atol=0.05)


def test_the_coarser_the_voxels_the_more_alike_all_pixels_count():
    model, spreads = [NoiseModel(0.0, 0.002)], []
    for across in (1.0, 4.0, 16.0):
        spreads.append(weigh_pixels([flame(4)], [ALL], model, [across]).variance_ratio)
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[0] > 3 * spreads[-1]


def test_unusable_pixels_say_nothing_of_those_around_them():
    image, mask = steps(1.0, 5.0), ALL.copy()
    mask[20:40, 10:30] = False
    spoilt = np.where(mask, image, 1e6)
    spoilt[25, 15] = np.nan
    model = [NoiseModel(0.0, 1.0)]
    found, clean = (
        weigh_pixels([each], [mask], model, [4.0]).images[0] for each in (spoilt, image)
    )
    assert_array_equal(found, clean)
    far = np.arange(WIDTH) < 30  # of the brighter half
    assert_allclose(found[:, far], found[0, 0], rtol=1e-6)


@pytest.mark.parametrize("scale", [1e-30, 1e-6, 1e6, 1e30])
def test_brightness_does_not_matter(scale):
    image = steps(0.0, 1.0, 3.0, 2.0)
    plain = weigh_pixels([image], [ALL], [NoiseModel(0.01, 0.2)], [4.0])
    scaled = weigh_pixels([image * scale], [ALL], [NoiseModel(0.01 * scale, 0.2 * scale)], [4.0])
    assert_allclose(scaled.images[0], plain.images[0], rtol=1e-5)


@pytest.mark.parametrize("mask", [ALL, ~ALL])
def test_dark_images_and_none_to_use_count_alike(mask):
    found = weigh_pixels([np.zeros((HEIGHT, WIDTH))], [mask], [NoiseModel(0.0)], [3.0])
    assert found.images is None
    assert found.variance_ratio == 1
