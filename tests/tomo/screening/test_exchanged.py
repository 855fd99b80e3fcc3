"""Two cameras with each other's images are named, and right ones are not."""

from dataclasses import replace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import VoxelGrid
from tomo.measurement import estimate_noise
from tomo.screening import find_exchanged
from tomo.simulation import simulate_images

GRID = VoxelGrid((20, 32, 20), 1.0)
RIG = rigs.ring(6, distance=300.0, image_size=(60, 72), footprint=0.5, pitch_degrees=12)


@pytest.fixture(scope="module")
def images():
    field = phantoms.create("turbulent", seed=3, extent=GRID.extent)
    made = simulate_images(RIG, field, GRID, supersample=2, seed=3)
    return [made.images[name] for name in RIG.names]


def exchanged(images, first, second):
    order = list(range(len(images)))
    order[first], order[second] = second, first
    return [images[view] for view in order]


def found(images, rig=RIG):
    masks = [np.isfinite(image) for image in images]
    return find_exchanged(rig, images, masks, GRID, [estimate_noise(i) for i in images])


def test_right_cameras_are_not_exchanged(images):
    assert found(images) is None
    assert found(images[:2], replace(RIG, cameras=RIG.cameras[:2])) is None


def test_both_of_two_exchanged_are_named(images):
    for pair in ((0, 5), (1, 3)):
        assert found(exchanged(images, *pair)).cameras == tuple(RIG.names[n] for n in pair)
