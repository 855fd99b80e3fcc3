"""A camera whose image is mirrored or turned by half is named, few views or a held-out one too."""

import numpy as np
import pytest

import phantoms
import rigs
from tomo import VoxelGrid
from tomo.measurement import estimate_noise
from tomo.screening import find_turned_over
from tomo.simulation import simulate_images

GRID = VoxelGrid((20, 32, 20), 1.0)
RIG = rigs.ring(4, distance=300.0, image_size=(60, 72), footprint=0.5, pitch_degrees=12)
BACK = {
    "mirrored left to right": np.s_[:, ::-1],
    "mirrored upside down": np.s_[::-1],
    "turned by 180 degrees": np.s_[::-1, ::-1],
}


@pytest.fixture(scope="module")
def images():
    field = phantoms.create("turbulent", seed=3, extent=GRID.extent)
    made = simulate_images(RIG, field, GRID, supersample=2, seed=3)
    return [made.images[name] for name in RIG.names]


def found(images, trusted=None):
    masks = [np.isfinite(image) for image in images]
    noise = [estimate_noise(image) for image in images]
    return find_turned_over(RIG, images, masks, GRID, noise, trusted)


def turned(images, view, words):
    shown = list(images)
    shown[view] = np.ascontiguousarray(shown[view][BACK[words]])
    return shown


def test_right_images_are_not_turned_over(images):
    assert found(images) is None
    assert found(images, trusted=3) is None
    assert found(images, trusted=2) is None  # two views say nothing of each other


@pytest.mark.parametrize("words", BACK)
def test_the_camera_and_the_way_it_is_turned_are_named(images, words):
    one = found(turned(images, 2, words))
    assert (one.camera, one.words) == (RIG.names[2], words)


def test_a_held_out_camera_is_named_too(images):
    one = found(turned(images, 3, "mirrored left to right"), trusted=3)
    assert (one.camera, one.words) == (RIG.names[3], "mirrored left to right")


def test_a_moved_image_is_not_turned_over(images):
    moved = [*images[:3], np.roll(images[3], 4, axis=1)]
    assert found(moved) is None


def test_what_to_do_fits_the_way_it_is_turned(images):
    assert "image[:, ::-1]" in found(turned(images, 1, "mirrored left to right")).needs
    assert "image[::-1]" in found(turned(images, 1, "mirrored upside down")).needs
    half = found(turned(images, 1, "turned by 180 degrees")).needs
    assert f"--rotate {RIG.names[1]}=180" in half
