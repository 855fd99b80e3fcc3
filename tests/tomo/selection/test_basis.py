import math

import numpy as np
import pytest

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.selection.basis import error_ratio
from tomo.simulation import simulate

GRID = VoxelGrid((12, 16, 12), 1.0)


def systems(views):
    rig = rigs.ring(
        views, distance=300.0, image_size=(40, 48), footprint=0.45, start_degrees=7.0,
        pitch_degrees=np.resize([15.0, -15.0], views),
    )  # fmt: skip
    boxes = LinearSystem.from_rig(rig, GRID)
    return boxes, boxes.with_linear_basis().projector


@pytest.mark.parametrize("views", [5, 10])
def test_smooth_light_is_left_to_splines_and_rough_light_to_boxes(views):
    boxes, splines = systems(views)
    field = phantoms.GaussianBlobs([[0.5, 1, -1], [-1, -2, 1]], [1.8, 1.4], [1.0, 0.8])
    scan = simulate(boxes.rig, field, GRID, supersample=3, refine=4)
    smooth = boxes.flatten(list(scan.images.values()))
    assert error_ratio(splines, boxes.projector, smooth) < 0.7
    rough = np.random.default_rng(0).random(boxes.projector.shape[1]).astype(np.float32)
    assert error_ratio(splines, boxes.projector, boxes.projector @ rough) > 1.5


def test_nothing_is_said_of_two_views_or_of_dark_images():
    boxes, splines = systems(2)
    ones = np.ones(boxes.projector.shape[0], np.float32)
    assert math.isnan(error_ratio(splines, boxes.projector, ones))
    boxes, splines = systems(4)
    dark = np.zeros(boxes.projector.shape[0], np.float32)
    assert math.isnan(error_ratio(splines, boxes.projector, dark))
