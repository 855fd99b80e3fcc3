"""Wild pixels are found, singly and in pairs; what a lens can draw, and noise, is left alone."""

import numpy as np
import pytest

from tomo.measurement import find_outlier_pixels

ROWS, COLUMNS = np.mgrid[0:60, 0:50]
BLOB = np.exp(-(((ROWS - 30) / 12) ** 2) - ((COLUMNS - 25) / 8) ** 2).astype(np.float32)


def spot(sigma, row=30.0, column=25.0):
    away = (ROWS - row) ** 2 + (COLUMNS - column) ** 2
    return np.exp(-away / (2 * sigma**2)).astype(np.float32)


@pytest.mark.parametrize("place", [(30, 25), (28, 20), (5, 8), (0, 25), (59, 30), (30, 49)])
@pytest.mark.parametrize("value", [-0.1, 0.0, 2.0, 1e6, 1e30])
def test_one_outlier_pixel_is_found_and_its_neighbours_are_spared(place, value):
    image = BLOB + np.float32(0.4)
    image[place] = value
    assert np.argwhere(find_outlier_pixels(image)).tolist() == [list(place)]


@pytest.mark.parametrize("second", [(30, 26), (31, 25), (31, 26)])
def test_two_outlier_pixels_side_by_side_are_found(second):
    image = BLOB.copy()
    image[30, 25] = image[second] = 4.0
    assert sorted(map(tuple, np.argwhere(find_outlier_pixels(image)).tolist())) == sorted(
        [(30, 25), second]
    )


@pytest.mark.parametrize("sigma", [0.7, 1.0, 3.0])
@pytest.mark.parametrize("off", [0.0, 0.5])
def test_a_spot_that_a_lens_can_draw_is_real(sigma, off):
    bright = spot(sigma, column=25 + off)
    assert not find_outlier_pixels(bright).any()
    assert not find_outlier_pixels(1 - 0.7 * bright).any()
    assert not find_outlier_pixels(BLOB + bright).any()


def test_edges_lines_and_corners_are_real():
    edge = (COLUMNS + 0.3 * ROWS > 30).astype(np.float32)
    assert not find_outlier_pixels(edge).any()
    line = np.exp(-((COLUMNS - 25.3) ** 2) / (2 * 0.6**2)).astype(np.float32)
    assert not find_outlier_pixels(line).any()
    corner = ((COLUMNS > 20) & (ROWS > 30)).astype(np.float32)
    assert not find_outlier_pixels(corner).any()


@pytest.mark.parametrize("degrees", [0, 3, 20, 22.5, 45, 80, 90])
@pytest.mark.parametrize("off", [0.0, 0.3, 0.5])
def test_creases_are_real(degrees, off):
    """A box seen on edge: nothing, then light in proportion to the depth behind the edge."""
    angle = np.radians(degrees)
    across = np.cos(angle) * (COLUMNS - 25 - off) + np.sin(angle) * (ROWS - 30)
    depth = np.clip(across, 0, 8).astype(np.float32)
    assert not find_outlier_pixels(depth).any()
    assert not find_outlier_pixels(8 - depth).any()
    assert not find_outlier_pixels(np.where(ROWS < 40, depth, 0)).any()


def test_a_slope_that_leaves_the_image_is_real():
    assert not find_outlier_pixels(ROWS.astype(np.float32)).any()
    assert not find_outlier_pixels(spot(12.0, row=0.0, column=0.0)).any()


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_the_unit_of_intensity_does_not_matter(scale):
    image = BLOB.copy()
    image[30, 25] = 3.0
    assert np.array_equal(
        find_outlier_pixels(image * np.float32(scale)), find_outlier_pixels(image)
    )
    assert np.count_nonzero(find_outlier_pixels(image)) == 1


@pytest.mark.parametrize(
    "noisy",
    [
        *(lambda r, s=s: BLOB + s * r.standard_normal(BLOB.shape) for s in (0.01, 0.1, 0.5)),
        *(lambda r, n=n: r.poisson(n * BLOB) / n for n in (10, 100, 1000)),
    ],
)
def test_white_noise_and_counted_photons_raise_no_alarm(noisy):
    random = np.random.default_rng(0)
    found = sum(np.count_nonzero(find_outlier_pixels(noisy(random))) for _ in range(20))
    assert found <= 1e-4 * 20 * BLOB.size


def test_pixels_that_are_not_usable_say_nothing():
    mask = np.ones(BLOB.shape, bool)
    mask[25:35, 20:30] = False
    image = BLOB.copy()
    image[~mask] = 50.0
    assert not find_outlier_pixels(image, mask).any()
    image[10, 25] = np.nan
    assert not find_outlier_pixels(image, mask).any()


def test_images_with_nothing_to_compare():
    assert not find_outlier_pixels(np.zeros((20, 20))).any()
    assert not find_outlier_pixels(np.ones((3, 3))).any()
    assert not find_outlier_pixels(BLOB, np.zeros(BLOB.shape, bool)).any()
