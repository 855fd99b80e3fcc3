"""MC-Calib's file, written here by ``cv2.FileStorage`` in its documented layout."""

import re

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigs import formats
from rigs.formats import mccalib


def written(path, rig, **changes):
    """Write the file; ``changes`` are fields of the second camera, None removes one."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("nb_camera", len(rig))
    for index, camera in enumerate(rig):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.R, camera.t
        fields = {
            "camera_matrix": np.array(camera.camera_matrix),
            "distortion_vector": np.array([camera.distortion.coefficients or (0.0,) * 5]),
            "distortion_type": int(camera.distortion.model == "fisheye"),
            "camera_group": 0,
            "img_width": camera.image_size[0],
            "img_height": camera.image_size[1],
            "camera_pose_matrix": np.linalg.inv(pose),
        }
        storage.startWriteStruct(f"camera_{index}", cv2.FILE_NODE_MAP)
        for key, value in {**fields, **(changes if index == 1 else {})}.items():
            if value is not None:
                storage.write(key, value)
        storage.endWriteStruct()
    storage.release()
    return path


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_mccalib(make_rig, assert_projects, tmp_path, suffix):
    rig = make_rig("brown", "fisheye", "none")
    path = written(tmp_path / f"calibrated_cameras_data{suffix}", rig)
    assert formats.sniff(path) == "mccalib"
    found = formats.load(path)
    assert found.names == ("camera_0", "camera_1", "camera_2")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    for camera in found:
        node = storage.getNode(camera.name)

        def by_opencv(points, node=node):
            to_camera = np.linalg.inv(node.getNode("camera_pose_matrix").mat())
            rvec, t = cv2.Rodrigues(to_camera[:3, :3])[0], to_camera[:3, 3]
            K, D = (node.getNode(key).mat() for key in ("camera_matrix", "distortion_vector"))
            is_fisheye = node.getNode("distortion_type").real() == 1
            project = cv2.fisheye.projectPoints if is_fisheye else cv2.projectPoints
            return project(points[:, None], rvec, t, K, D)[0][:, 0]

        assert_projects(camera, by_opencv)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"distortion_type": 2}, "camera camera_1: distortion_type: found 2, expected 0 (persp"),
        ({"camera_group": 1}, "camera camera_1: camera_group: found 1, expected 0 as of camera_0"),
        ({"camera_pose_matrix": np.eye(3)}, "camera camera_1: camera_pose_matrix: found"),
        ({"camera_matrix": None}, "camera camera_1: camera_matrix: missing"),
        ({"img_width": None}, "camera camera_1: img_width: found nothing, expected a finite"),
        ({"camera_group": None}, "camera camera_1: camera_group: missing"),
    ],
)
def test_what_is_wrong_is_named(make_rig, tmp_path, changes, message):
    path = written(tmp_path / "a.yml", make_rig("brown", "none"), **changes)
    with pytest.raises(ValueError, match=re.escape(f"{path}: {message}")):
        formats.load(path)


def test_a_camera_that_is_lost_is_missed(make_rig, tmp_path):
    path = written(tmp_path / "a.yml", make_rig("brown", "none"))
    path.write_text(path.read_text().replace("camera_1:", "camera_one:"))
    with pytest.raises(ValueError, match="nb_camera: found 2, expected 1 as there are cameras"):
        formats.load(path)


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=35)
def test_broken_files_are_refused_or_read(make_rig, read_or_refused, damaged, tmp_path, data):
    file = written(tmp_path / "a.yml", make_rig("brown", "fisheye", seed=1))
    file.write_text(damaged(file.read_text(), data))
    rig = read_or_refused(mccalib.load, file)
    assert rig is None or len(rig)
