import numpy as np
import pytest
from scipy.optimize import nnls

from tomo.measurement import NoiseModel, estimate_noise
from tomo.measurement.noise_model import (
    MOST_LEVELS,
    PIXELS_A_LEVEL,
    QUARTER_OF_A_NORMAL,
    REWEIGHTINGS,
)
from tomo.simulation import camera_noise

ROWS, COLUMNS = np.mgrid[0:200, 0:120]
FLAME = np.exp(-(((ROWS - 90) / 50) ** 2) - ((COLUMNS - 60) / 18) ** 2)  # dark, bright, slopes
FLAME[FLAME < 1e-3] = 0
SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0])


def random(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("fraction", [0.003, 0.03, 0.1])
def test_gaussian_noise_is_found(fraction):
    model = estimate_noise(camera_noise.gaussian(FLAME, fraction, random()))
    assert model.read == pytest.approx(fraction, rel=0.1)
    assert model.gain < 0.2 * fraction**2


@pytest.mark.parametrize(("photons", "read"), [(100, 2.0), (1000, 10.0), (20_000, 20.0)])
def test_photon_noise_is_distinguished_from_read_noise(photons, read):
    model = estimate_noise(camera_noise.poisson(FLAME, photons, read, random()))
    assert model.read == pytest.approx(read / photons, rel=0.15)
    assert model.gain == pytest.approx(1 / photons, rel=0.3)


def test_the_scale_of_the_image_scales_the_model():
    noisy = camera_noise.poisson(FLAME, 500, 4.0, random())
    one, many = estimate_noise(noisy), estimate_noise(1000 * noisy)
    assert many.read == pytest.approx(1000 * one.read, rel=1e-6)
    assert many.gain == pytest.approx(1000 * one.gain, rel=1e-6)


def test_a_smooth_image_without_noise_has_next_to_none():
    model = estimate_noise(FLAME)
    assert np.sqrt(model.variance(FLAME)).max() < 1e-3


def test_a_background_cut_out_does_not_hide_the_noise():
    noisy = camera_noise.gaussian(FLAME + 0.3 * (FLAME > 0.02), 0.01, random())
    noisy[FLAME <= 0.02] = 0
    assert estimate_noise(noisy).read == pytest.approx(0.013, rel=0.2)


def test_masked_pixels_have_no_say():
    noisy = camera_noise.gaussian(FLAME, 0.02, random())
    mask = COLUMNS < 70
    spoilt = np.where(mask, noisy, 50 * random(1).standard_normal(FLAME.shape))
    spoilt[0, 119] = np.nan
    assert estimate_noise(spoilt, mask).read == pytest.approx(0.02, rel=0.1)


def line_twin(level, variance):
    """Return the read-out noise and gain of the line, a least-squares fit at a time."""
    level, expected = np.maximum(level, 0), np.full_like(variance, variance.mean())
    for _ in range(REWEIGHTINGS):
        root = 1 / np.maximum(expected, 1e-6 * expected.max())
        columns = np.stack([np.ones_like(level), level], axis=1)
        intercept, slope = nnls(root[:, None] * columns, root * variance)[0]
        expected = intercept + slope * level
    return np.sqrt(intercept), slope


def noise_twin(image, mask, expected):
    """Return the model pixel by pixel, and the levels by sorting all of them."""
    values = image.astype(np.float64)
    signal = values if expected is None else expected.astype(np.float64)
    shown = values if expected is None else values - signal
    found = []
    for row in range(image.shape[0] - 2):
        for column in range(image.shape[1] - 2):
            nine = slice(row, row + 3), slice(column, column + 3)
            usable = np.isfinite(image[nine]) if mask is None else mask[nine]
            if usable.all() and (image[nine] == 0).sum() < 2:
                fine = SECOND_DIFFERENCE @ shown[nine] @ SECOND_DIFFERENCE / 6
                found.append((signal[nine].mean(), abs(fine)))
    parts = min(max(len(found) // PIXELS_A_LEVEL, 1), MOST_LEVELS)
    found = np.array(sorted(found)[len(found) % parts :]).reshape(parts, -1, 2)
    spread = np.sort(found[:, :, 1], axis=1)[:, found.shape[1] // 4] / QUARTER_OF_A_NORMAL
    return NoiseModel(*line_twin(found[:, :, 0].mean(axis=1), spread**2))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("with_mask", [False, True])
@pytest.mark.parametrize("with_expected", [False, True])
def test_the_model_is_that_of_its_twin(dtype, with_mask, with_expected):
    flame = FLAME[:90, :83]
    seen = camera_noise.poisson(flame, 500, 4.0, random()).astype(dtype)
    seen[4:9, 70:] = 0
    seen[60, 10] = np.nan
    mask = np.isfinite(seen)
    mask[30:33, 20:25] = False
    mask = mask if with_mask else None
    unlike = flame + 1e-6 * random(1).random(flame.shape)  # no two levels are the same
    expected = unlike if with_expected else None
    found, twin = estimate_noise(seen, mask, expected), noise_twin(seen, mask, expected)
    assert found.read > 0
    np.testing.assert_allclose([found.read, found.gain], [twin.read, twin.gain], rtol=1e-9)


def test_images_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"^mask: found shape \(120, 200\), expected \(200,"):
        estimate_noise(FLAME, FLAME.T > 0)
    with pytest.raises(ValueError, match=r"^expected: found shape \(199, 120\), expected"):
        estimate_noise(FLAME, expected=FLAME[1:])


@pytest.mark.parametrize("image", [np.zeros((2, 50)), np.zeros((9, 9)), np.full((9, 9), np.nan)])
def test_an_image_that_says_nothing(image):
    assert estimate_noise(image) == NoiseModel(0.0)


@pytest.mark.parametrize("numbers", [(-1.0, 0.0), (0.0, np.nan), (np.inf, 0.0)])
def test_a_model_of_no_numbers_is_refused(numbers):
    with pytest.raises(ValueError, match="expected a finite number >= 0"):
        NoiseModel(*numbers)
