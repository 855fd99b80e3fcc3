"""How coarse quick systems are: as many segments as asked, however much of an image is empty."""

from dataclasses import replace

import numpy as np
import pytest

from rigs import Rig, ring
from tomo import LinearSystem, VoxelGrid
from tomo.pipeline.coarse import factor_of

GRID = VoxelGrid((48, 96, 48), 1.0)
TIGHT = ring(6, 30.0, 1000.0, image_size=(160, 160), footprint=0.625)
SEGMENTS = 200_000


def _with_margin(camera, pixels):
    """Return a camera whose image is larger by so many pixels on every side."""
    K = camera.camera_matrix + np.array([[0, 0, pixels], [0, 0, pixels], [0, 0, 0]])
    width, height = camera.image_size
    return replace(camera, camera_matrix=K, image_size=(width + 2 * pixels, height + 2 * pixels))


@pytest.mark.parametrize("margin", [40, 400])
def test_pixels_that_see_nothing_of_the_grid_do_not_count(margin):
    wide = Rig(tuple(_with_margin(camera, margin) for camera in TIGHT))
    assert factor_of(wide, GRID, SEGMENTS) == factor_of(TIGHT, GRID, SEGMENTS) > 1


@pytest.mark.parametrize("margin", [0, 400])
def test_segments_are_about_as_many_as_asked(margin):
    wide = Rig(tuple(_with_margin(camera, margin) for camera in TIGHT))
    factor = factor_of(wide, GRID, SEGMENTS)
    smaller = np.diag([1 / factor, 1 / factor, 1])
    size = tuple(n // factor for n in wide[0].image_size)
    coarse = [
        replace(camera, camera_matrix=smaller @ camera.camera_matrix, image_size=size)
        for camera in wide
    ]
    grid = VoxelGrid(tuple(n // factor for n in GRID.shape), float(factor))
    found = LinearSystem.from_rig(Rig(tuple(coarse)), grid).projector.n_segments
    assert SEGMENTS / 2 < found < SEGMENTS * 2
