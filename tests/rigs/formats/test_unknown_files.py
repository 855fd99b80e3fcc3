"""What is no rig is refused with the format that comes nearest."""

import re

import pytest

from rigs import formats


def test_a_file_like_ours_gets_the_error_of_ours(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("version: 1\nlength_unit: mm\ncameras: []\n")
    with pytest.raises(ValueError, match="format: missing, expected emission-rig"):
        formats.load(path)


KALIBR = (
    "cam0:\n  camera_model: pinhole\n  intrinsics: [90.0, 90.0, 32.0, 24.0]\n"
    "  distortion_model: none\n  distortion_coeffs: []\n  resolution: [64, 48]\n"
)


@pytest.mark.parametrize(
    ("name", "text", "nearest"),
    [
        ("a.yaml", KALIBR.replace("intrinsics", "lens"),
         "nearest is kalibr (Kalibr's camchain.yaml): lacks intrinsics"),
        ("a.json", '{"img_name": 1, "width": 1, "height": 1, "position": 1, "rotation": 1}',
         "nearest is gaussian_splatting (3-D Gaussian splatting's cameras.json): lacks fx, fy"),
        ("a.dat", "[cam]\nsize = 1\nmatrix = 1\ndistortions = 1\nrotation = 1\ntranslation = 1\n",
         "nearest is anipose (TOML of anipose, Pose2Sim, FreeMoCap, caliscope): try --from anip"),
    ],
)  # fmt: skip
def test_the_nearest_format_is_named_with_what_is_missing(tmp_path, name, text, nearest):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"; {re.escape(nearest)}"):
        formats.load(path)


def test_a_folder_that_holds_one_known_file_is_that_file(tmp_path):
    (tmp_path / "calibration.yaml").write_text(KALIBR)
    (tmp_path / "notes.txt").write_text("taken on Monday\n")
    (tmp_path / "image.png").write_bytes(b"")
    assert formats.sniff(tmp_path) == "kalibr"
    for format_name in (None, "kalibr"):
        assert formats.load(tmp_path, format_name).names == ("cam0",)
    (tmp_path / "other.yaml").write_text(KALIBR)
    words = r"found 2 rigs, calibration.yaml \(kalibr\), other.yaml \(kalibr\), expected one of"
    with pytest.raises(ValueError, match=words):
        formats.load(tmp_path)
