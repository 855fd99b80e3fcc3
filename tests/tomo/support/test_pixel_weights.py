"""What pixels are worth: one over the variance of their noise and of what voxels miss."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tomo.support import NoiseModel, estimate_noise, weigh_pixels
from tomo.support.pixel_weights import EVEN, MISFIT

HEIGHT, WIDTH = 60, 80
ALL = np.ones((HEIGHT, WIDTH), bool)


def steps(*levels):
    """Return an image of vertical stripes, wide enough for each middle to know no other."""
    return np.repeat(np.float64(levels), WIDTH // len(levels))[None].repeat(HEIGHT, axis=0)


def middles(image, count):
    return image[HEIGHT // 2, WIDTH // count // 2 :: WIDTH // count]


def test_a_weight_is_one_over_the_variance_of_noise_and_of_what_voxels_miss():
    levels = np.array([0.0, 1.0, 4.0, 10.0])
    found = weigh_pixels([steps(*levels)], [ALL], [NoiseModel(0.3, 0.2)])
    variances = 0.3**2 + 0.2 * levels + (MISFIT * 10) ** 2
    assert_allclose(middles(found.images[0], 4), variances[0] / variances, rtol=1e-6)
    assert found.spread == pytest.approx(variances[3] / variances[0], rel=1e-6)
    assert found.report() == {
        "used": True,
        "reason": f"the noisiest pixels have {found.spread:.3g} times the variance of others",
    }


def test_a_noisier_camera_is_worth_less():
    image = steps(1.0, 2.0)
    found = weigh_pixels([image, image], [ALL, ALL], [NoiseModel(0.1), NoiseModel(0.4)])
    quiet, noisy = ((read**2 + (2 * MISFIT) ** 2) for read in (0.1, 0.4))
    assert_allclose(found.images[0], 1, rtol=1e-6)
    assert_allclose(found.images[1], quiet / noisy, rtol=1e-6)


@pytest.mark.parametrize("gain", [0.0, 1e-5])
def test_pixels_about_as_noisy_as_each_other_count_alike(gain):
    found = weigh_pixels([steps(0.0, 1.0)], [ALL], [NoiseModel(0.1, gain)])
    assert found.images is None
    assert 1 <= found.spread < EVEN
    assert not found.report()["used"]


def test_gaussian_noise_is_even_and_that_of_photons_is_not():
    random = np.random.default_rng(3)
    across, down = np.meshgrid(np.linspace(-2, 2, WIDTH), np.linspace(-2, 2, HEIGHT))
    flame = np.exp(-(across**2) - down**2)
    for images, even in (
        ([flame + random.normal(0, 0.1, flame.shape) for _ in range(8)], True),
        ([random.poisson(200 * flame) / 200 for _ in range(8)], False),
    ):
        models = [estimate_noise(image) for image in images]
        assert (weigh_pixels(images, [ALL] * 8, models).images is None) == even


def test_unusable_pixels_say_nothing_of_those_around_them():
    image, mask = steps(1.0, 5.0), ALL.copy()
    mask[20:40, 10:30] = False
    wild = np.where(mask, image, 1e6)
    wild[25, 15] = np.nan
    model = [NoiseModel(0.0, 1.0)]
    found, clean = (weigh_pixels([each], [mask], model).images[0] for each in (wild, image))
    assert_array_equal(found, clean)
    far = np.arange(WIDTH) < 30  # of the brighter half
    assert_allclose(found[:, far], found[0, 0], rtol=1e-6)


@pytest.mark.parametrize("scale", [1e-30, 1e-6, 1e6, 1e30])
def test_brightness_does_not_matter(scale):
    image = steps(0.0, 1.0, 3.0, 2.0)
    plain = weigh_pixels([image], [ALL], [NoiseModel(0.01, 0.02)])
    scaled = weigh_pixels([image * scale], [ALL], [NoiseModel(0.01 * scale, 0.02 * scale)])
    assert_allclose(scaled.images[0], plain.images[0], rtol=1e-5)


@pytest.mark.parametrize("mask", [ALL, ~ALL])
def test_dark_images_and_none_to_use_count_alike(mask):
    found = weigh_pixels([np.zeros((HEIGHT, WIDTH))], [mask], [NoiseModel(0.0)])
    assert found.images is None
    assert found.spread == 1
