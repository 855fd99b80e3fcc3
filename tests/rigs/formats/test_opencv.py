import json

import cv2
import numpy as np
import pytest
import yaml

from rigs import formats

ALL = ("none", "brown", "rational", "thin_prism", "tilted", "fisheye")
SAMPLE = """%YAML:1.0
---
calibration_time: "Mon 13 May 2019 10:00:00"
image_width: 640
image_height: 480
flags: 0
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.3591573396163199e+02, 0., 3.4228315473308373e+02, 0.,
       5.3591573396163199e+02, 2.3557082909788173e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.6637260909660682e-01, -3.8588898922304653e-02,
       1.7831947042852964e-03, -2.8122100441115472e-04,
       2.3839153080878486e-01 ]
avg_reprojection_error: 3.9e-01
"""


@pytest.mark.parametrize("suffix", [".yml", ".json", ".xml"])
def test_rigs_come_back(make_rig, assert_same_views, tmp_path, suffix):
    rig = make_rig(*ALL)
    path = tmp_path / f"rig{suffix}"
    formats.save(rig, path, "opencv")
    assert formats.sniff(path) == "opencv"
    assert_same_views(formats.load(path), rig)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_folder_of_a_file_a_camera(make_rig, assert_same_views, tmp_path):
    rig = make_rig(*ALL)
    formats.save(rig, tmp_path / "rig", "opencv")
    assert sorted(p.name for p in (tmp_path / "rig").iterdir()) == [
        f"cam{i}.yml" for i in range(6)
    ]
    assert formats.sniff(tmp_path / "rig") == "opencv"
    assert_same_views(formats.load(tmp_path / "rig"), rig)


@pytest.mark.parametrize("suffix", [".yml", ".json", ".xml"])
@pytest.mark.parametrize("model", ALL)
def test_opencv_itself_reads_and_projects_what_is_written(make_rig, tmp_path, suffix, model):
    rig = make_rig(model)
    formats.save(rig, tmp_path / f"one{suffix}", "opencv")
    file = cv2.FileStorage(str(tmp_path / f"one{suffix}"), cv2.FILE_STORAGE_READ)
    K, D, R, T = (
        file.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients", "R", "T")
    )
    origins, directions = rig[0].rays(np.random.default_rng(0).uniform(100, 400, (200, 2)))
    points = origins + 300 * directions
    project = cv2.fisheye.projectPoints if model == "fisheye" else cv2.projectPoints
    uv, *_ = project(points[:, None], cv2.Rodrigues(R)[0], T, K, D)
    np.testing.assert_allclose(rig[0].project(points)[0], uv[:, 0], atol=1e-6)
    assert int(file.getNode("image_width").real()) == 640
    assert int(file.getNode("fisheye_model").real()) == (model == "fisheye")


def test_the_calibration_samples_own_file(tmp_path):
    (tmp_path / "left.yml").write_text(SAMPLE)
    rig = formats.load(tmp_path / "left.yml")
    assert rig.names == ("left",)
    assert rig[0].image_size == (640, 480)
    assert rig[0].status == "nominal"  # there is no pose in it
    assert rig[0].distortion.coefficients[4] == 2.3839153080878486e-01
    (tmp_path / "right.yml").write_text(SAMPLE)
    assert formats.load(tmp_path).names == ("left", "right")


def test_a_mapping_of_names(make_rig, assert_same_views, tmp_path):
    rig = make_rig("brown", "none")
    data = {
        camera.name: {
            "image_size": list(camera.image_size),
            "K": camera.camera_matrix.tolist(),
            "dist_coeffs": list(camera.distortion.coefficients) or [0] * 5,
            "rvec": cv2.Rodrigues(np.array(camera.R))[0].ravel().tolist(),
            "tvec": camera.t.tolist(),
        }
        for camera in rig
    }
    (tmp_path / "rig.json").write_text(json.dumps(data))
    assert_same_views(formats.load(tmp_path / "rig.json", "opencv"), rig)
    (tmp_path / "rig.yml").write_text(yaml.safe_dump({"cameras": data}))
    assert_same_views(formats.load(tmp_path / "rig.yml", "opencv"), rig)


@pytest.mark.parametrize("given", ["intrinsics.yml", "extrinsics.yml", ""])
def test_the_stereo_samples_files(make_rig, assert_same_views, tmp_path, given):
    left, right = make_rig("brown", "rational")
    turn = right.R @ left.R.T
    storage = cv2.FileStorage(str(tmp_path / "intrinsics.yml"), cv2.FILE_STORAGE_WRITE)
    for index, camera in enumerate((left, right), 1):
        storage.write(f"M{index}", np.array(camera.camera_matrix))
        storage.write(f"D{index}", np.array([camera.distortion.coefficients]))
    storage.release()
    storage = cv2.FileStorage(str(tmp_path / "extrinsics.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("R", turn)
    storage.write("T", (right.t - turn @ left.t).reshape(3, 1))
    for key in ("R1", "P1", "Q"):
        storage.write(key, np.eye(3))
    storage.release()
    rig = formats.load(tmp_path / given, image_size=(640, 480))
    expected = make_rig("brown", "rational").transformed(left.R, left.t)
    assert_same_views(rig, expected, ("left", "right"))
    with pytest.raises(ValueError, match=r"image_size: missing.*--image-size"):
        formats.load(tmp_path / given)


def storage_of(path, fields):
    """Write fields as ``cv2.FileStorage`` does: matrices, numbers, text, and lists of them."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in fields.items():
        if isinstance(value, list):
            storage.startWriteStruct(key, cv2.FILE_NODE_SEQ)
            for item in value:
                storage.write("", item)
            storage.endWriteStruct()
        else:
            storage.write(key, value)
    storage.release()
    return path


SUFFIXES = pytest.mark.parametrize("suffix", [".yml", ".json", ".xml"])


@SUFFIXES
@pytest.mark.parametrize("plural", [False, True])
def test_lists_of_one_length_are_cameras(make_rig, assert_same_views, tmp_path, suffix, plural):
    rig = make_rig("brown", "rational", "none")
    keys = ("cameraMatrices", "distCoeffsList", "rvecs", "tvecs")
    K, D, R, T = keys if plural else ("camera_matrix", "distortion_coefficients", "R", "T")
    fields = {
        "image_width": 640,
        "image_height": 480,
        K: [np.array(c.camera_matrix) for c in rig],
        D: [np.array([c.distortion.coefficients or (0.0,) * 5]) for c in rig],
        R: [cv2.Rodrigues(np.array(c.R))[0] if plural else np.array(c.R) for c in rig],
        T: [np.array(c.t).reshape(3, 1) for c in rig],
    }
    path = storage_of(tmp_path / f"rig{suffix}", fields)
    assert_same_views(formats.load(path), rig, ("camera0", "camera1", "camera2"))
    path = storage_of(tmp_path / f"short{suffix}", {**fields, R: fields[R][:2]})
    with pytest.raises(ValueError, match=rf"{R}: found .*, expected a list of 3"):
        formats.load(path)


@SUFFIXES
def test_multicalibs_numbered_keys(make_rig, assert_same_views, tmp_path, suffix):
    rig = make_rig("brown", "none")
    fields = {"nCameras": 2}
    for index, camera in enumerate(rig):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.R, camera.t
        fields[f"camera_matrix_{index}"] = np.array(camera.camera_matrix)
        lens = np.array([camera.distortion.coefficients or (0.0,) * 5])
        fields[f"camera_distortion_{index}"] = lens
        fields[f"camera_pose_{index}"] = pose
    path = storage_of(tmp_path / f"multi{suffix}", {**fields, "meanReprojectError": 0.3})
    assert formats.sniff(path) == "opencv"
    with pytest.raises(ValueError, match=r"camera camera_0: image_size: missing.*--image-size"):
        formats.load(path)
    found = formats.load(path, image_size=(640, 480))
    assert_same_views(found, rig, ("camera_0", "camera_1"))
    storage_of(path, {**fields, "xi_1": 0.9})
    with pytest.raises(ValueError, match="camera camera_1: xi: found it, as of an omnidirect"):
        formats.load(path, image_size=(640, 480))


@SUFFIXES
@pytest.mark.parametrize(
    "size", [np.array([[640, 480]]), np.array([[640.0], [480.0]]), [640, 480]]
)
def test_an_image_size_of_any_form(tmp_path, suffix, size):
    fields = {"camera_matrix": np.diag([800.0, 800, 1]), "dist_coeffs": np.zeros((1, 5))}
    path = storage_of(tmp_path / f"a{suffix}", {"image_size": size, **fields})
    assert formats.load(path)[0].image_size == (640, 480)


def test_a_folder_of_files_of_several_cameras(make_rig, assert_same_views, tmp_path):
    rig = make_rig("brown", "none", "fisheye")
    formats.save(rig[:2], tmp_path / "left.yml")
    formats.save(rig[2:], tmp_path / "top.xml", "opencv")
    storage_of(tmp_path / "board.yml", {"board_width": 9, "square_size": 25.0})
    found = formats.load(tmp_path)
    assert_same_views(found[:2], rig[:2])
    assert_same_views(found[2:], rig[2:], ("cam2",))
    formats.save(rig[1:2], tmp_path / "top.xml", "opencv")
    with pytest.raises(ValueError, match=r"top.xml: camera cam1: found in another file too"):
        formats.load(tmp_path)


ORB_SLAM = """%YAML:1.0
# Camera calibration and distortion parameters (OpenCV)
Camera.type: "PinHole"
Camera.fx: 458.654
Camera.fy: 457.296
Camera.cx: 367.215
Camera.cy: 248.375
Camera.k1: -0.28340811
Camera.width: 752
"""


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("EuRoC.yaml", ORB_SLAM),
        ("settings.xml", "<?xml version='1.0'?><opencv_storage><Camera.type>a</Camera.type>"
         "<Camera.fx>1.</Camera.fx></opencv_storage>"),
    ],
)  # fmt: skip
def test_unknown_keys_are_named(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=r"camera_matrix: missing, found Camera.type, Camera.fx"):
        formats.load(path)


def test_half_a_stereo_pair_is_refused(tmp_path):
    path = tmp_path / "intrinsics.yml"
    path.write_text("%YAML:1.0\n---\nM1: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n")
    with pytest.raises(
        ValueError, match=r"intrinsics.yml: R: missing, expected it here or in ext"
    ):
        formats.load(path)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (("image_width: 640\n", ""), "camera left: image_size: missing"),
        (("image_height: 480\n", ""), "camera left: image_height: found nothing, expected"),
        (("cols: 1", "cols: 2"), "distortion_coefficients.data: found 5 numbers, expected 5 x 2"),
        (("distortion_coeff", "distorted_coeff"), "distortion_coefficients: missing"),
        (("fisheye_model: 0", "fisheye_model: 1"), "found 5 coefficients, expected 4"),
        (("5.3591573396163199e+02, 0.,", ".Nan, 0.,"), "camera_matrix.data: found"),
        (("fisheye_model: 0", "distortion_model: mei"), "distortion_model: found 'mei'"),
        (("camera_matrix", "R: [1, 2, 3, 4]\ncamera_matrix"), "camera left: R: found"),
        (("camera_matrix", "R: [0, 0, 1]\ncamera_matrix"), "camera left: T: missing"),
    ],
)
def test_what_is_wrong_is_named(refused_as, tmp_path, edit, message):
    assert edit[0] in SAMPLE
    path = tmp_path / "left.yml"
    path.write_text(SAMPLE.replace(*edit))
    refused_as(path, message, path, "opencv")


def test_poses_are_all_there_or_none_is(make_rig, tmp_path):
    path = tmp_path / "rig.json"
    formats.save(make_rig("brown", "none"), path)
    data = json.loads(path.read_text())
    del data["cameras"][1]["R"]
    path.write_text(json.dumps(data))
    with pytest.raises(ValueError, match="camera cam1: R: missing"):
        formats.load(path)


def test_what_is_refused_is_not_warned_of_too(tmp_path, caplog):
    path = tmp_path / "calib.yml"
    path.write_text("%YAML:1.0\n---\ncamera_matrix: [[1, 0, 0], [0, 1, 0]]\nimage_width: 4\n")
    with pytest.raises(ValueError, match="camera_matrix"):
        formats.load(path)
    assert not caplog.records


@pytest.mark.parametrize("ending", [".yml", ".json", ".xml"])
def test_arrays_of_one_dimension(make_rig, assert_same_views, tmp_path, ending):
    """``cv2.FileStorage`` writes NumPy's arrays of one dimension as they are."""
    rig = make_rig("brown")
    path = tmp_path / f"a{ending}"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    (camera,) = rig
    file.write("image_width", 640)
    file.write("image_height", 480)
    file.write("camera_matrix", np.array(camera.camera_matrix))
    file.write("distortion_coefficients", np.array(camera.distortion.coefficients))
    file.write("R", cv2.Rodrigues(np.array(camera.R))[0].ravel())
    file.write("T", np.array(camera.t))
    file.release()
    assert "sizes" in path.read_text()
    assert_same_views(formats.load(path), rig, names=("a",))
    path.write_text(path.read_text().replace("[ 3 ]", "[ 4 ]").replace("3</sizes>", "4</sizes>"))
    if ending != ".json":
        with pytest.raises(
            ValueError, match=r"sizes: found .* and 3 numbers, expected one or two"
        ):
            formats.load(path)


def test_a_name_with_a_slash_is_made_usable_and_said(tmp_path, caplog):
    """ROS calls the cameras of a pair so."""
    for name in ("left", "right"):
        (tmp_path / f"{name}.yaml").write_text(
            f"image_width: 64\nimage_height: 48\ncamera_name: narrow_stereo/{name}\n"
            "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [90, 0, 32, 0, 90, 24, 0, 0, 1]\n"
            "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
            "  data: [-0.1, 0.05, 0, 0, 0]\n"
        )
    assert formats.load(tmp_path / "left.yaml").names == ("narrow_stereo_left",)
    assert "camera 'narrow_stereo/left': called narrow_stereo_left" in caplog.text
    assert formats.load(tmp_path).names == ("narrow_stereo_left", "narrow_stereo_right")


def test_cameras_of_an_older_rig_do_not_come_back(make_rig, tmp_path):
    rig = make_rig("brown", "none")
    formats.save(rig, tmp_path / "rig", "opencv")
    formats.save(rig, tmp_path / "rig", "opencv")
    storage_of(tmp_path / "rig" / "board.yml", {"board_width": 9})
    with pytest.raises(ValueError, match=r"cam1\.yml: found cameras of another rig"):
        formats.save(rig[:1], tmp_path / "rig", "opencv")
