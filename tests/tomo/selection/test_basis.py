import math

import numpy as np
import pytest

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.selection.basis import error_ratio
from tomo.simulation import simulate_images

GRID = VoxelGrid((12, 16, 12), 1.0)


def systems(views):
    rig = rigs.ring(
        views, distance=300.0, image_size=(40, 48), footprint=0.45, start_degrees=7.0,
        pitch_degrees=np.resize([15.0, -15.0], views),
    )  # fmt: skip
    voxels = LinearSystem.from_rig(rig, GRID)
    return voxels, voxels.with_linear_basis().projector


@pytest.mark.parametrize("views", [5, 10])
def test_smooth_light_is_left_to_splines_and_rough_light_to_boxes(views):
    voxels, linear = systems(views)
    field = phantoms.GaussianBlobs([[0.5, 1, -1], [-1, -2, 1]], [1.8, 1.4], [1.0, 0.8])
    scan = simulate_images(voxels.rig, field, GRID, supersample=3, refine=4)
    smooth = voxels.flatten(list(scan.images.values()))
    assert error_ratio(linear, voxels.projector, smooth) < 0.7
    rough = np.random.default_rng(0).random(voxels.projector.shape[1]).astype(np.float32)
    assert error_ratio(linear, voxels.projector, voxels.projector @ rough) > 1.5


def test_nothing_is_said_of_two_views_or_of_dark_images():
    voxels, linear = systems(2)
    ones = np.ones(voxels.projector.shape[0], np.float32)
    assert math.isnan(error_ratio(linear, voxels.projector, ones))
    voxels, linear = systems(4)
    dark = np.zeros(voxels.projector.shape[0], np.float32)
    assert math.isnan(error_ratio(linear, voxels.projector, dark))
