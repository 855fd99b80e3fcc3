"""Folders of images of a known flame, laid out as people do."""

from types import SimpleNamespace

import numpy as np
import pytest

import rigs
from phantoms import GaussianBlobs
from rigs.recordings import write_image
from tomo import VoxelGrid
from tomo.simulation import simulate_images

GRID = VoxelGrid((14, 20, 14), 0.8, (3, -2, 1))
DARK, TOP = 120, 3400  # counts of 12 bits


@pytest.fixture(scope="session")
def scene():
    """Return six cameras around a flame at (3, -2, 1), and their images without noise."""
    field = GaussianBlobs(
        [[2.6, -4.0, 0.4], [3.4, -2.0, 1.5], [3.0, 0.4, 0.9]], [1.0, 0.9, 0.8], [1.0, 0.8, 0.9]
    )
    ring = rigs.ring(
        6, distance=200.0, image_size=(60, 72), footprint=0.4, pitch_degrees=[10, -8] * 3
    )
    rig = ring.transformed(np.eye(3), GRID.center)
    rig = rigs.Rig(tuple(rig), "mm")
    made = simulate_images(rig, field, GRID, supersample=2, refine=2)
    return SimpleNamespace(rig=rig, images=made.images, truth=made.truth, field=field, grid=GRID)


@pytest.fixture
def counts(scene):
    """Return a function: camera to an image in counts of 12 bits, with dark level and noise."""
    rng = np.random.default_rng(0)
    top = max(image.max() for image in scene.images.values())

    def make(camera, light=1.0):
        image = light * scene.images[camera] / top * TOP + DARK
        return np.rint(image + rng.normal(0, 4, image.shape)).astype(np.uint16)

    return make


@pytest.fixture
def laid_out(scene, counts, tmp_path):
    """Return a function that writes images and dark frames by layouts, and the rig beside them."""

    def make(images, dark=None, frames=("0001", "0002"), rig="rig.yaml", name="run"):
        folder = tmp_path / name
        for camera in scene.rig.names:
            for frame in frames:
                write_image(folder / images.format(c=camera, f=frame), counts(camera))
                if dark is not None:
                    write_image(folder / dark.format(c=camera, f=frame), counts(camera, 0.0))
        if rig is not None:
            rigs.save_rig(scene.rig, folder / rig)
        return folder

    return make
