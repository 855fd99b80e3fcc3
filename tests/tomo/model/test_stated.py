"""What a rig says of its errors comes to pixels of images, whatever their size."""

from dataclasses import replace

import numpy as np
import pytest

import rigs
from rigs import Accuracy, RayTable
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel
from tomo.model import Observation, Pose
from tomo.model.pose import NOMINAL, stated_errors

GRID = VoxelGrid((8, 8, 8), 1.0)
FOOTPRINT, RADIUS = 0.4, 20.0
VIRTUAL = rigs.ring(3, distance=100.0, image_size=(60, 40), footprint=FOOTPRINT)
RING = replace(VIRTUAL, cameras=tuple(replace(c, status="calibrated") for c in VIRTUAL))
KNOWN = Accuracy(shift=0.3, roll=0.5, magnification=0.01, direction=2.0)
IN_PIXELS = [0.3, 0.3, np.deg2rad(0.5) * RADIUS, 0.2, *[np.deg2rad(2) * RADIUS] * 2]


def with_first(rig, **changes):
    return replace(rig, cameras=(replace(rig[0], **changes), *rig[1:]))


def test_accuracies_are_angles_and_fractions_of_half_an_image():
    found = stated_errors(with_first(RING, accuracy=KNOWN), GRID)
    np.testing.assert_allclose(found[0], IN_PIXELS)
    np.testing.assert_array_equal(found[1:], 0)


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_they_are_as_much_of_any_coarser_image(factor):
    table = RayTable.of(RING[2].with_accuracy(KNOWN))
    nominal = replace(RING[1], status="nominal")
    rig = replace(RING, cameras=(RING[0].with_accuracy(KNOWN), nominal, table))
    coarse = replace(rig, cameras=tuple(c.shrunk(factor) for c in rig))
    found = stated_errors(coarse, GRID, factor)
    np.testing.assert_allclose(found * factor, stated_errors(rig, GRID))
    assert found[1, 0] * factor == NOMINAL.shift


def test_status_stands_for_what_is_not_stated():
    for status in ("calibrated", "virtual"):
        assert not stated_errors(with_first(RING, status=status), GRID).any()
    one = with_first(RING, status="nominal", accuracy=Accuracy(shift=0.2))
    found = stated_errors(one, GRID)
    np.testing.assert_allclose(found[0, :2], 0.2)
    assert found[0, 3] == NOMINAL.magnification * RADIUS
    assert not found[1:].any()


def record(**figures):
    return {"length_unit": "mm", "cameras": {"cam00": figures}}


def test_figures_of_a_calibration_stand_for_a_missing_accuracy():
    figures = {"ray_miss": 0.08, "focal_length_error": 0.003}
    rig = replace(RING, calibration=record(**figures))
    miss = 0.08 / FOOTPRINT
    found = stated_errors(rig, GRID)
    np.testing.assert_allclose(found[0], [miss, miss, miss, 0.003 * RADIUS, miss, miss])
    assert not found[1:].any()
    both = stated_errors(with_first(rig, accuracy=Accuracy(direction=2.0)), GRID)
    np.testing.assert_allclose(both[0, 4:], IN_PIXELS[4:])
    np.testing.assert_allclose(both[0, :4], found[0, :4])
    nominal = stated_errors(with_first(rig, status="nominal"), GRID)
    assert nominal[0, 0] == NOMINAL.shift


@pytest.mark.parametrize(
    "calibration",
    [
        None,
        {"cameras": 3},
        {"cameras": {"cam00": "good"}},
        record(ray_miss="0.1"),
        record(ray_miss=float("nan"), focal_length_error=-1.0),
        record(ray_miss=0.08) | {"length_unit": "m"},
    ],
)
def test_records_of_other_kinds_say_nothing(calibration):
    assert not stated_errors(replace(RING, calibration=calibration), GRID).any()


def test_any_camera_may_have_been_knocked():
    """The prior of a pose is that of mounts, however exact or rough the rig says it is."""
    images = tuple(np.zeros(c.image_size[::-1], np.float32) for c in RING)
    masks = tuple(image == 0 for image in images)
    cameras = (RING[0].with_accuracy(KNOWN), replace(RING[1], status="nominal"), RING[2])
    rig = replace(RING, cameras=cameras)
    seen = Observation(rig, images, masks, (NoiseModel(0.01),) * 3, GRID)
    alike = replace(seen, rig=RING)
    np.testing.assert_array_equal(Pose().deviation(seen), Pose().deviation(alike))
    assert (Pose().deviation(seen)[:, :4] == Pose.sigma).all()
    tables = replace(seen, rig=rigs.as_ray_tables(rig))
    found = Pose().deviation(tables)
    assert (found[:, :2] == Pose.sigma).all()
    assert (found[:, 2:4] < 1e-3 * Pose.sigma).all()  # they have no roll and no zoom
