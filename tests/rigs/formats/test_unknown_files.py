"""What is no rig is refused with the names that stand in it."""

import re

import pytest

from rigs import formats


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("settings.yaml", "Camera.fx: 458.6\nCamera.fy: 457.2\n", "Camera.fx, Camera.fy"),
        ("scan.json", '{"a\x0b\u2028": 1, "width": 640, "poses": [{"q": 1}]}', "width, poses, q"),
        ("calib.xml", "<?xml version='1.0'?>\n<Calib><F>1</F></Calib>", "Calib, F"),
        ("anipose.toml", "[camera]\nx = 1\n[video]\ny = 2\n", "camera, video"),
    ],
)
def test_the_names_in_a_file_are_named(tmp_path, name, text, found):
    path = tmp_path / name
    path.write_text(text)
    words = re.escape(f"{path}: found none of the rig formats, expected a file or folder")
    with pytest.raises(ValueError, match=rf"{words} .*; found in it: {re.escape(found)}$"):
        formats.load(path)


def test_a_file_like_ours_gets_the_error_of_ours(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("version: 1\nlength_unit: mm\ncameras: []\n")
    with pytest.raises(ValueError, match="format: missing, expected emission-rig"):
        formats.load(path)
