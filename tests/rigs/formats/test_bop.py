"""BOP's scenes, written here by the layout of its dataset format."""

import json
import re

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigs import formats
from rigs.formats import bop


def scene(rig):
    return {
        str(7 * index): {
            "cam_K": camera.camera_matrix.ravel().tolist(),
            "depth_scale": 0.1,
            "cam_R_w2c": camera.R.ravel().tolist(),
            "cam_t_w2c": camera.t.tolist(),
            "view_level": 0,
        }
        for index, camera in enumerate(rig)
    }


def write(folder, data):
    path = folder / "scene_camera.json"
    path.write_text(json.dumps(data))
    return path


def test_a_scene(make_rig, assert_projects, tmp_path):
    data = scene(make_rig("none", "none", skew=0.4))
    path = write(tmp_path, data)
    assert formats.sniff(path) == "bop"
    rig = formats.load(path, image_size=(640, 480))
    assert rig.names == ("000000", "000007")
    assert rig.length_unit == "mm"
    for camera, entry in zip(rig, data.values(), strict=True):

        def by_matrix(points, entry=entry):
            motion = np.c_[np.reshape(entry["cam_R_w2c"], (3, 3)), entry["cam_t_w2c"]]
            P = np.reshape(entry["cam_K"], (3, 3)) @ motion  # P_w2i of BOP's page
            seen = np.c_[points, np.ones(len(points))] @ P.T
            return seen[:, :2] / seen[:, 2:]

        assert_projects(camera, by_matrix)


def test_the_image_size_is_that_of_the_images_or_asked_for(make_rig, tmp_path):
    path = write(tmp_path, scene(make_rig("none", "none")))
    with pytest.raises(ValueError, match=r"camera 000000: image_size: missing.*--image-size"):
        formats.load(path)
    for folder, name in (("rgb", "000000.png"), ("gray", "000007.tif")):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / name), np.zeros((480, 640), np.uint8))
    assert [camera.image_size for camera in formats.load(path)] == [(640, 480)] * 2


def test_a_size_that_a_writer_adds_is_read(make_rig, tmp_path):
    data = scene(make_rig("none"))
    data["0"] |= {"width": 640, "height": 480}
    assert formats.load(write(tmp_path, data))[0].image_size == (640, 480)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            ("0", "cam_R_w2c"),
            None,
            "camera 000000: cam_R_w2c: missing, expected the image's pose",
        ),
        (("0", "cam_t_w2c"), None, "camera 000000: cam_t_w2c: missing"),
        (("0", "cam_K"), [[1, 0, 0]] * 3, "camera 000000: cam_K: found"),
        (("0", "cam_R_w2c"), [1] * 9, "camera 000000: cam_R_w2c: not orthonormal"),
        (("left",), {}, "'left': found it among the images, expected their numbers"),
        (("0",), 3, "camera 000000: entry: found 3, expected a mapping"),
    ],
)
def test_what_is_wrong_is_named(make_rig, mutated, tmp_path, path, value, message):
    file = write(tmp_path, mutated(scene(make_rig("none", "none")), path, value))
    with pytest.raises(ValueError, match=re.escape(f"{file}: {message}")):
        formats.load(file, image_size=(640, 480))


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=35)
def test_broken_files_are_refused_or_read(make_rig, read_or_refused, damaged, tmp_path, data):
    file = tmp_path / "scene_camera.json"
    file.write_text(damaged(json.dumps(scene(make_rig("none", seed=1))), data))
    rig = read_or_refused(lambda path: bop.load(path, (640, 480)), file)
    assert rig is None or len(rig)
