import numpy as np
import pytest

from tomo.measurement import NoiseModel, usable_pixels
from tomo.simulation import camera_noise

ROWS, COLUMNS = np.mgrid[0:60, 0:50]
BLOB = np.exp(-(((ROWS - 30) / 12) ** 2) - ((COLUMNS - 25) / 8) ** 2).astype(np.float32)


def test_a_smooth_image_is_usable_whole():
    assert usable_pixels(BLOB).all()
    assert usable_pixels(np.zeros((5, 5))).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_not_usable(value):
    image = BLOB.copy()
    image[3, 4] = value
    assert np.argwhere(~usable_pixels(image)).tolist() == [[3, 4]]


@pytest.mark.parametrize("place", [(30, 25), (28, 20), (0, 25), (59, 49)])
@pytest.mark.parametrize("value", [-0.1, 9.0])
def test_dead_and_hot_pixels_are_found_and_their_neighbours_spared(place, value):
    image = BLOB + np.float32(0.2)
    image[place] = value
    assert np.argwhere(~usable_pixels(image)).tolist() == [list(place)]


@pytest.mark.parametrize("sigma", [0.7, 1.0, 3.0])
@pytest.mark.parametrize("off", [0.0, 0.5])
def test_a_small_spot_is_real(sigma, off):
    away = (ROWS - 30 - off) ** 2 + (COLUMNS - 25) ** 2
    assert usable_pixels(np.exp(-away / (2 * sigma**2))).all()
    assert usable_pixels(1 - 0.7 * np.exp(-away / (2 * sigma**2))).all()


def test_noise_makes_no_pixel_unusable():
    noisy = camera_noise.gaussian(BLOB, 0.1, np.random.default_rng(0))
    assert usable_pixels(noisy, None, NoiseModel(0.1)).all()


def test_too_large_a_dark_frame_makes_no_pixel_dead():
    below = BLOB - np.float32(0.2)
    assert usable_pixels(below).all()
    below[3, 4] = -0.5
    assert np.argwhere(~usable_pixels(below)).tolist() == [[3, 4]]


def test_masks_stay_and_their_pixels_judge_nobody():
    mask = np.ones(BLOB.shape, bool)
    mask[30, 24] = False
    image = BLOB.copy()
    image[30, 24] = 1e6
    assert (usable_pixels(image, mask) == mask).all()
    alone = np.zeros(BLOB.shape, bool)
    alone[10, 10] = True
    assert (usable_pixels(image, alone) == alone).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scale", [1e-36, 3.3e38])
def test_the_faintest_and_the_brightest_images_are_judged_like_others(scale):
    image = (BLOB + np.float32(0.2)) / np.float32(1.2)
    image[10, 10] = 1.0  # hot where the flame is not
    image[30, 25] = 0.0
    expected = usable_pixels(image)
    assert not expected[10, 10]
    assert (usable_pixels(image * np.float32(scale)) == expected).all()


def _judged_by_all_neighbours(image, mask, noise):
    """The same pixel by pixel, each asked of all its neighbours at once."""
    usable = np.isfinite(image) & mask
    found, largest = usable.copy(), image[usable].max(initial=0)
    if largest <= 0:
        return found
    for row, column in np.argwhere(usable):
        around = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        others = usable[around].copy()
        others[row - around[0].start, column - around[1].start] = False
        if not others.any():
            continue
        high, low = image[around][others].max(), image[around][others].min()
        sigma = np.sqrt(noise.variance(max(low, 0)))
        far = np.float32(max(8 * sigma, 0.05 * largest))
        hot = image[row, column] / 4 > abs(high) + far / 4
        dead = image[row, column] < min(low, low / 4) - far
        found[row, column] = not (hot or dead)
    return found


@pytest.mark.parametrize("seed", range(12))
def test_pixels_are_judged_as_by_asking_all_their_neighbours(seed):
    random = np.random.default_rng(seed)
    shape = random.integers(3, 12, 2)
    image = np.exp(3 * random.standard_normal(shape)) - (seed % 2) * random.random(shape)
    image = (image * 10.0 ** (seed % 5 - 2)).astype(np.float32)
    image[random.random(shape) < 0.05] = np.nan
    mask = random.random(shape) < (1.0 if seed % 3 else 0.8)
    noise = NoiseModel(0.01 * (seed % 7) * float(np.nanmax(image)))
    found = usable_pixels(image, mask, noise)
    np.testing.assert_array_equal(found, _judged_by_all_neighbours(image, mask, noise))
    assert found.any()
