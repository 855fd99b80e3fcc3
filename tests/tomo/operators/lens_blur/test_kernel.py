import numpy as np
import pytest

from rigs import Rig
from tomo import VoxelGrid
from tomo.operators import lens_blur
from tomo.operators.lens_blur import disc_kernel

WIDTHS = pytest.mark.parametrize("width", [0.0, 0.02, 0.7, 1.0, 1.001, 1.5, 3.3, 4.0, 9.6, 61.3])


@WIDTHS
def test_a_disc_is_even_and_all_there(width):
    offsets, weight = disc_kernel(width)
    assert weight.sum() == pytest.approx(1, abs=1e-6)
    assert (weight > 0).all()
    weights = dict(zip(map(tuple, offsets.tolist()), weight.tolist(), strict=True))
    for (x, y), value in weights.items():
        for other in ((-x, y), (y, x), (-y, -x)):
            assert weights[other] == pytest.approx(value)
    if width <= 1:
        assert weights == {(0, 0): 1.0}


@pytest.mark.parametrize("width", [2.0, 3.3, 4.0, 9.6, 300.0])
def test_a_disc_has_its_variance(width):
    """``d² / 16`` along an axis, and about that of the pixel that it is laid out in."""
    offsets, weight = disc_kernel(width)
    variance = float(weight @ offsets[:, 0] ** 2)
    assert variance == pytest.approx(width**2 / 16 + 1 / 12, abs=0.06, rel=1e-4)


def test_light_stays_in_its_view_and_what_misses_the_pixels_is_lost(cameras, matrix_of):
    rig, grid = cameras.rig, cameras.grid
    every = np.arange(64 * 144)
    some = np.flatnonzero(np.random.default_rng(0).random(64 * 144) < 0.7)
    blur = lens_blur(rig, [every, some, *[every[:0]] * 10], grid, 1.0)
    blur = matrix_of(blur)
    assert blur.dtype == np.float32
    assert blur.shape == (len(every) + len(some),) * 2
    assert blur[: len(every), len(every) :].nnz == 0
    assert blur[len(every) :, : len(every)].nnz == 0
    sums = blur.sum(axis=1)
    image = sums[: len(every)].reshape(144, 64)
    np.testing.assert_allclose(image[4:-4, 4:-4], 1, atol=1e-6)
    assert image[0].max() < 0.7
    own = blur[0, 0]  # a pixel that takes part is always its own neighbour
    expected = own + 0.7 * (sums[: len(every)].mean() - own)
    assert sums[len(every) :].mean() == pytest.approx(expected, rel=0.02)
    assert abs(blur - blur.T).max() < 1e-9


def test_voxels_blur_by_themselves(cameras):
    """A disc of no more variance than a voxel leaves the rays as they are."""
    rig, coarse = cameras.rig, VoxelGrid((6, 20, 6), 1.5)
    pixels = [np.arange(64 * 144)] * len(rig)
    image = np.random.default_rng(0).random(12 * 64 * 144)
    alone, wider = (lens_blur(rig, pixels, coarse, width) for width in (1.7, 2.5))
    np.testing.assert_array_equal(alone @ image, image)
    assert min(len(weight) for _, weight in wider.kernels) > 10


@pytest.mark.parametrize("blur", [0.0, -1.0, np.nan, np.inf])
def test_no_diameter_is_refused(cameras, blur):
    with pytest.raises(ValueError, match=r"^blur: found .*, expected a diameter above 0$"):
        lens_blur(cameras.rig, cameras.system.pixels, cameras.grid, blur)


def test_a_disc_that_no_image_holds_is_refused(cameras):
    one = cameras
    words = "blur: camera cam00: found a disc of 148 pixels, expected one within its image of 64 x"
    with pytest.raises(ValueError, match=words):
        lens_blur(one.rig, one.system.pixels, one.grid, 37.0)


def test_a_grid_behind_a_camera_is_refused(cameras):
    one = cameras.rig[0]
    behind = VoxelGrid((2, 2, 2), 1.0, tuple(2 * one.position))
    assert np.isnan(Rig((one,)).footprint(behind.center)).all()
    with pytest.raises(ValueError, match=f"blur: camera {one.name}: found the grid's centre"):
        lens_blur(Rig((one,)), [np.arange(3)], behind, 4.0)
