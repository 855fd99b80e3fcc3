"""What is known of a camera's errors stays with it as far as it holds, through any change."""

import math

import pytest
from scipy.spatial.transform import Rotation

from rigs import Accuracy, RayTable, Rig, as_ray_tables, ring, with_cameras
from rigs.files.units import in_unit
from rigs.scene import Scene, SceneCamera

KNOWN = Accuracy(shift=0.4, roll=0.05, magnification=0.002, direction=0.1)
LENS = ring(3, distance=100.0, image_size=(40, 30), footprint=0.5)[1].with_accuracy(KNOWN)
CAMERAS = {"lens": LENS, "table": RayTable.of(LENS), "scene": SceneCamera(LENS, Scene())}


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf, "much", True, [1.0]])
@pytest.mark.parametrize("field", ["shift", "roll", "magnification", "direction"])
def test_what_is_no_deviation_is_refused_in_one_line(field, value):
    with pytest.raises(ValueError, match=rf"^accuracy\.{field}: found .*, expected a number of"):
        Accuracy(**{field: value})


@pytest.mark.parametrize("kind", CAMERAS)
def test_no_motion_of_the_world_or_the_image_changes_it(kind):
    camera = CAMERAS[kind]
    R = Rotation.from_rotvec([0.3, -1, 0.2]).as_matrix()
    for same in (
        camera,
        camera.transformed(R, [5, 6, 7]),
        camera.with_lengths_scaled(1000.0),
        camera.cropped(3, 2, 20, 18),
        camera.rotated(90),
        camera.shifted(1.5, -2),
        camera.renamed("other"),
    ):
        assert same.accuracy == KNOWN
    rig = with_cameras(in_unit(Rig((camera,)), "m"), {camera.name: "new"})
    assert rig["new"].accuracy == KNOWN
    assert as_ray_tables(rig)[0].accuracy == KNOWN


@pytest.mark.parametrize("kind", CAMERAS)
def test_a_shift_is_in_pixels_and_follows_their_size(kind):
    camera = CAMERAS[kind]
    assert camera.scaled(0.5).accuracy == Accuracy(0.2, 0.05, 0.002, 0.1)
    assert camera.shrunk(4).accuracy == Accuracy(0.1, 0.05, 0.002, 0.1)
    part = camera.with_accuracy(Accuracy(roll=0.2)).scaled(0.5)
    assert part.accuracy == Accuracy(roll=0.2)


def test_another_pose_has_none():
    for camera in (CAMERAS["lens"], CAMERAS["scene"]):
        own = getattr(camera, "camera", camera)
        assert camera.with_pose(own.camera_matrix, own.R, own.t).accuracy is None
        assert camera.with_accuracy(None).accuracy is None


@pytest.mark.parametrize("kind", CAMERAS)
def test_it_is_a_part_of_the_cameras_value(kind):
    camera = CAMERAS[kind]
    other = camera.with_accuracy(Accuracy(shift=0.5))
    assert other != camera
    assert other.with_accuracy(KNOWN) == camera
    assert hash(other.with_accuracy(KNOWN)) == hash(camera)


def test_it_is_an_accuracy_or_none():
    for camera in (CAMERAS["lens"], CAMERAS["table"]):
        with pytest.raises(ValueError, match=rf"^camera {camera.name}: accuracy: found 0\.3, exp"):
            camera.with_accuracy(0.3)
    assert repr(KNOWN) in repr(LENS)
