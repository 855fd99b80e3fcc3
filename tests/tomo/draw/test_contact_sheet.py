"""The sheet of thumbnails: a picture of every camera, the box where each sees it."""

import io

import numpy as np
import pytest
from PIL import Image

from rigs import ring
from tomo import VoxelGrid
from tomo.draw.rig.contact_sheet import contact_sheet

GRID = VoxelGrid((10, 20, 10), 1.0)


def sheet(count, size=(40, 60), grid=GRID, level=0):
    rig = ring(count, distance=300.0, image_size=size, footprint=0.6)
    images = {name: np.full(size[::-1], level, np.uint8) for name in rig.names}
    return np.asarray(Image.open(io.BytesIO(contact_sheet(rig, images, grid, "a $_ title"))))


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("size", [(40, 60), (90, 30)])
def test_every_camera_has_its_picture(count, size):
    shown = sheet(count, size)[..., :3].astype(int)
    black = shown.sum(axis=-1) < 30  # inferno's darkest
    height, width = black.shape
    assert 0.2 < height / width < 3
    cells = black.any(axis=0).sum() / width, black.any(axis=1).sum() / height
    assert min(cells) > 0.5  # no picture is squeezed into a corner
    assert black.mean() > 0.25


def test_the_box_is_drawn_where_it_is_and_not_elsewhere():
    def blue(grid):
        shown = sheet(1, grid=grid)[100:, :, :3].astype(int)  # below the title
        at = np.argwhere((shown[..., 2] > 150) & (shown[..., 0] < 150) & (shown[..., 1] > 120))
        return np.ptp(at, axis=0) if len(at) else np.zeros(2)

    tall, wide = blue(GRID), blue(VoxelGrid((20, 10, 10), 1.0))
    assert tall[0] > 1.5 * tall[1]
    assert wide[1] > 1.5 * wide[0]
    assert not blue(VoxelGrid((10, 20, 10), 1.0, (0, 900, 0))).any()


def test_the_same_images_give_the_same_bytes():
    rig = ring(2, distance=300.0, image_size=(20, 20), footprint=1.0)
    images = {name: (np.arange(400) % 256).astype(np.uint8).reshape(20, 20) for name in rig.names}
    assert contact_sheet(rig, images, GRID) == contact_sheet(rig, images, GRID)
