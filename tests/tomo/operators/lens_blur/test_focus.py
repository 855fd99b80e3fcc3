from dataclasses import replace

import numpy as np
import pytest

from rigs import Rig
from tomo import VoxelGrid
from tomo.measurement import blur_of_images
from tomo.simulation import camera_noise


def test_the_disc_of_a_lens_is_found(out_of_focus):
    one = out_of_focus
    assert blur_of_images(one.rig, one.images, one.grid) == pytest.approx(one.blur, rel=0.06)


def test_pinholes_show_none(in_focus):
    assert blur_of_images(in_focus.rig, in_focus.images, in_focus.grid) is None


@pytest.mark.parametrize("scale", [1e-20, 1e20])
def test_units_of_light_do_not_matter(out_of_focus, scale):
    one = out_of_focus
    found = [blur_of_images(one.rig, one.images, one.grid)]
    found.append(blur_of_images(one.rig, [scale * image for image in one.images], one.grid))
    assert found[1] == pytest.approx(found[0])


def test_units_of_length_are_the_rigs(out_of_focus):
    one, far = out_of_focus, []
    for camera in one.rig:
        far.append(replace(camera, t=1000 * camera.t))
    grid = VoxelGrid(one.grid.shape, 500.0)
    found = blur_of_images(Rig(tuple(far)), one.images, grid)
    assert found == pytest.approx(1000 * blur_of_images(one.rig, one.images, one.grid))


def test_cameras_that_see_coarser_pixels_count_as_well(out_of_focus):
    """Every second camera of larger pixels: a disc has one diameter in the flame."""
    cameras, images = [], []
    for number, (camera, image) in enumerate(
        zip(out_of_focus.rig, out_of_focus.images, strict=True)
    ):
        if number % 2:
            camera = camera.scaled(0.875)
            columns, rows = camera.image_size
            image = _resampled(image, rows, columns)
        cameras.append(camera)
        images.append(image)
    grid = out_of_focus.grid
    sizes = Rig(tuple(cameras)).footprint(grid.center)
    assert sizes[1] == pytest.approx(sizes[0] / 0.875)
    found = blur_of_images(Rig(tuple(cameras)), images, grid)
    assert found == pytest.approx(out_of_focus.blur, rel=0.08)


def _resampled(image, rows, columns):
    """Return the image at fewer pixels, by its Fourier series: nothing is blurred."""
    spectrum = np.fft.fftshift(np.fft.fft2(image.astype(np.float64)))
    top, left = (image.shape[0] - rows) // 2, (image.shape[1] - columns) // 2
    cut = spectrum[top : top + rows, left : left + columns]
    return np.fft.ifft2(np.fft.ifftshift(cut)).real * (rows * columns / image.size)


@pytest.mark.parametrize("fraction", [1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("name", ["in_focus", "out_of_focus"])
def test_noise_hides_discs_and_makes_none(request, name, fraction):
    one = request.getfixturevalue(name)
    noisy = camera_noise.gaussian(one.images, fraction, np.random.default_rng(0))
    assert blur_of_images(one.rig, noisy, one.grid) is None


def test_white_noise_alone_shows_none(in_focus):
    random = np.random.default_rng(1)
    images = [random.random(image.shape) for image in in_focus.images]
    assert blur_of_images(in_focus.rig, images, in_focus.grid) is None


def test_dark_tiny_or_unseen_images_show_none(in_focus):
    rig, grid = in_focus.rig, in_focus.grid
    dark = [np.zeros_like(image) for image in in_focus.images]
    assert blur_of_images(rig, dark, grid) is None
    tiny = Rig(tuple(replace(camera, image_size=(2, 3)) for camera in rig))
    assert blur_of_images(tiny, [np.ones((3, 2))] * len(rig), grid) is None
    behind = VoxelGrid((2, 2, 2), 1.0, tuple(2 * rig[0].position))
    assert blur_of_images(Rig((rig[0],)), in_focus.images[:1], behind) is None
