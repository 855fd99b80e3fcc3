"""Images that were cut off are distinguished from flames with a bright top."""

import numpy as np
import pytest

from tomo.measurement import NoiseModel, cut_off_level, estimate_noise


def flame(noise, bits, cut=np.inf, seed=0):
    random = np.random.default_rng(seed)
    rows, columns = np.indices((60, 80))
    image = 0.9 * np.exp(-(((rows - 31.3) / 14) ** 2) - ((columns - 38.6) / 9) ** 2)
    image = image + noise * np.sqrt(image + 0.01) * random.standard_normal(image.shape)
    image = np.minimum(image, cut)
    if bits:
        image = np.round(image * (2**bits - 1)) / (2**bits - 1)
    return image.astype(np.float32)


def level(image):
    return cut_off_level(image, np.isfinite(image), estimate_noise(image))


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01, 0.03])
@pytest.mark.parametrize("bits", [0, 6, 8, 12])
def test_only_a_cut_off_image_is_found(noise, bits):
    for seed in range(5):
        assert level(flame(noise, bits, seed=seed)) is None
        for cut in (0.7, 0.4):
            assert level(flame(noise, bits, cut, seed)) == pytest.approx(cut, abs=0.01)


def test_masked_pixels_and_dark_images_are_not_cut_off():
    image = flame(0.01, 12, 0.4)
    mask = image < 0.4
    assert cut_off_level(image, mask & (image < image[mask].max()), NoiseModel(0.0)) is None
    assert level(np.zeros((20, 20), np.float32)) is None
    assert cut_off_level(image, np.zeros(image.shape, bool), NoiseModel(0.0)) is None
