"""The TOML of anipose and Caliscope, written here by their documented layout."""

import cv2
import numpy as np
import pytest

from rigs import formats


def toml_of(rig, style):
    text = ""
    for index, camera in enumerate(rig):
        table = f"cam_{index}" if style == "anipose" else f"cameras.{index}"
        rotation = cv2.Rodrigues(np.array(camera.R))[0].ravel() if style == "anipose" else camera.R
        fields = {
            "size": camera.image_size,
            "matrix": camera.camera_matrix,
            "distortions": camera.distortion.coefficients or (0.0,) * 5,
            "rotation": rotation,
            "translation": camera.t,
        }
        lines = [f"{key} = {np.asarray(value).tolist()}" for key, value in fields.items()]
        name = f'name = "{camera.name}"' if style == "anipose" else f"cam_id = {index}"
        fisheye = str(camera.distortion.model == "fisheye").lower()
        text += "\n".join([f"[{table}]", name, *lines, f"fisheye = {fisheye}", ""]) + "\n"
    return text + "[metadata]\nadjusted = false\n"


@pytest.mark.parametrize("style", ["anipose", "caliscope"])
def test_anipose_and_caliscope(make_rig, assert_same_views, tmp_path, style):
    rig = make_rig("brown", "fisheye", "none")
    path = tmp_path / "calibration.toml"
    path.write_text(toml_of(rig, style))
    assert formats.sniff(path) == "anipose"
    assert_same_views(formats.load(path), rig)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("matrix = [[", "matrix = [[1], [", "camera cam0: matrix: found"),
        ("[cam_0]", "[cam_0", "broken TOML: "),
        ("fisheye = false", "fisheye = true", "camera cam0: distortions: found 5 coefficients"),
    ],
)
def test_what_is_wrong_in_toml_is_named(refused_as, make_rig, tmp_path, old, new, message):
    file = tmp_path / "calibration.toml"
    file.write_text(toml_of(make_rig("brown", "none"), "anipose").replace(old, new))
    refused_as(file, message, file, "anipose")


def test_every_table_of_a_camera_is_one_whatever_its_name(make_rig, assert_same_views, tmp_path):
    rig = make_rig("brown", "none", "fisheye")
    text = toml_of(rig, "anipose").replace("[cam_1]", "[top]").replace("[cam_2]", "[cam_20_M11]")
    path = tmp_path / "Calib.toml"
    path.write_text(text)
    assert_same_views(formats.load(path), rig)
    path.write_text(text.replace("fisheye = false", "fisheye = false\nignore = true", 1))
    assert formats.load(path).names == ("cam1", "cam2")  # caliscope's word for "leave it out"


@pytest.mark.parametrize("field", ["matrix", "distortions", "rotation", "translation", "size"])
def test_a_table_that_lacks_something_is_not_dropped(make_rig, tmp_path, field):
    path = tmp_path / "Calib.toml"
    first, second = toml_of(make_rig("brown", "none"), "anipose").split("[cam_1]")
    path.write_text(f"{first}[top]" + second.replace(f"{field} = ", f"other_{field} = "))
    with pytest.raises(ValueError, match=f"camera cam1: {field}: missing"):
        formats.load(path)


@pytest.mark.parametrize("pose", ["", 'rotation = "null"\ntranslation = "null"\n'])
def test_cameras_without_a_pose_are_left_out_and_named(
    make_rig, assert_same_views, tmp_path, caplog, pose
):
    """caliscope writes them where it could not place a camera, and pairs in older files."""
    path, rig = tmp_path / "config.toml", make_rig("brown", "none")
    lost = "[cam_7]\nsize = [640, 480]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
    lost += f"distortions = [0, 0, 0, 0, 0]\n{pose}"
    pair = "[stereo_0_1]\nRMSE = 0.3\nrotation = [[1, 0, 0]]\ntranslation = [1, 2, 3]\n"
    path.write_text(f"{toml_of(rig, 'anipose')}\n{lost}{pair}")
    assert_same_views(formats.load(path), rig)
    assert "left out 1 cameras without a pose: cam_7" in caplog.text
    path.write_text(lost + pair)
    with pytest.raises(ValueError, match="rotation, translation: found neither in any of 1 came"):
        formats.load(path)


def test_toml_without_cameras_names_its_tables(tmp_path):
    path = tmp_path / "Calib.toml"
    path.write_text("[metadata]\nadjusted = false\n[project]\nx = 1\n")
    with pytest.raises(ValueError, match="cameras: found none in metadata, project, expected"):
        formats.load(path, "anipose")
