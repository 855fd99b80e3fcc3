"""Rig files written by hand: little is enough, and whatever is wrong is one line that says so."""

import re

import numpy as np
import pytest

from rigs import Optics, Volume, camera_at, formats, load_rig, preset, save_rig

SHORT = """\
format: emission-rig
version: 1
cameras:
  - name: left
    image_size: [640, 480]
    focal_length: 50
    pixel_pitch: 5e-3
    position: [0, 0, 1000]
    look_at: [0, 0, 0]
    up: [0, 1, 0]
  - name: right
    image_size: [640, 480]
    camera_matrix: [[1000, 0, 320], [0, 1000, 240], [0, 0, 1]]
    distortion: {model: brown, coefficients: [0.1, 0, 0, 0]}
    R: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    t: [0, 0, 1000]
volume: {shape: [4, 5, 6], spacing: 0.5}
"""


def test_where_a_camera_stands_and_looks_is_enough(tmp_path):
    (tmp_path / "rig.yaml").write_text(SHORT)
    rig = load_rig(tmp_path / "rig.yaml")
    left = rig["left"]
    np.testing.assert_allclose(left.position, [0, 0, 1000])
    np.testing.assert_allclose(left.camera_matrix, [[1e4, 0, 319.5], [0, 1e4, 239.5], [0, 0, 1]])
    np.testing.assert_allclose(left.project([[0, 0, 0]])[0], [[319.5, 239.5]])
    assert left.project([[0, 1, 0]])[0][0, 1] < 239.5
    assert left.status == "nominal"
    assert rig.volume == Volume((4, 5, 6), 0.5)
    save_rig(rig, tmp_path / "again.yaml")
    assert load_rig(tmp_path / "again.yaml") == rig


def test_a_missing_file_is_named():
    with pytest.raises(FileNotFoundError, match=r"nowhere\.yaml: no such file"):
        load_rig("nowhere.yaml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("emission-rig", "rig", "format: found 'rig', expected emission-rig"),
        ("format: emission-rig\n", "", "format: missing, expected emission-rig"),
        ("version: 1", "version: 2", "version: found 2, expected 1"),
        ("model: brown", "model: foo", "camera right: distortion.model: found 'foo', expected "),
        ("[0.1, 0, 0, 0]", "[0.1]", "camera right: distortion.coefficients: found 1 for model "),
        ("[0.1, 0, 0, 0]", "[0.1, .nan, 0, 0]", "distortion.coefficients[1]: found nan, expected"),
        ("[[1, 0, 0], [0, 1", "[[-1, 0, 0], [0, 1", "camera right: R: mirrored (determinant -1)"),
        ("[[1, 0, 0], [0, 1", "[[1, 0, 0], [0, 2", "camera right: R: not orthonormal"),
        ("R: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "", "camera right: R: missing, expected R and t"),
        ("R: [[1, 0, 0],", "R: [[1, 0],", "camera right: R[0]: found 2 values, expected"),
        ("t: [0, 0, 1000]", "t: [0, 0, far]", "camera right: t[2]: found 'far', expected a num"),
        ("t: [0, 0, 1000]", "t: 5", "camera right: t: found 5, expected a list"),
        ("pixel_pitch: 5e-3", "", "camera left: pixel_pitch: missing"),
        ("pixel_pitch: 5e-3", "pixel_pitch: -1", "camera left: pixel_pitch: found -1.0"),
        ("pixel_pitch: 5e-3", "pixel_pich: 5e-3", "pixel_pich: unknown field, did you mean pixel"),
        ("up: [0, 1, 0]", "up: [0, 0, 1]", "camera left: up: found [0.0, 0.0, 1.0], expected a"),
        ("up: [0, 1, 0]", "R: [1]", "camera left: R[0]: found 1, expected a list"),
        ("t: [0, 0, 1000]", "t: [0, 0, 1000]\n    accuracy: {shift: -1}", "camera right: accurac"),
        (
            "t: [0, 0, 1000]",
            "t: [0, 0, 1000]\n    accuracy: {roll: .inf}",
            "camera right: accuracy.roll: found inf, expected a finite number",
        ),
        ("t: [0, 0, 1000]", "t: [0, 0, 1000]\n    accuracy: {zoom: 1}", "camera right: accuracy."),
        ("name: right", "name: left", "camera left: name: found twice"),
        ("name: right", "name: 7", "cameras[1]: name: found 7, expected text"),
        ("name: right", "label: right", "cameras[1]: label: unknown field"),
        ("[640, 480]\n    camera", "[640, 4.5]\n    camera", "camera right: image_size[1]: found"),
        ("[640, 480]\n    camera", "[640]\n    camera", "camera right: image_size: found 1 value"),
        ("[640, 480]\n    camera", "[0, 1]\n    camera", "camera right: image_size: found (0, 1)"),
        ("spacing: 0.5", "spacing: [1, 2]", "volume.spacing"),
        ("spacing: 0.5", "spacing: 0", "volume.spacing: found 0.0, expected positive"),
        ("shape: [4, 5, 6]", "shape: [4, 5, 0]", "volume.shape"),
        ("volume:", "volumes:", "volumes: unknown field, did you mean volume?"),
        ("cameras:", "cameras: []\nother:", "other: unknown field"),
        ("version: 1", "version: 1\nversion: 1", "version: found twice in one mapping, again at"),
        ("version: 1", "version: 1\nconvention: opengl", "convention: found 'opengl', expected o"),
        ("t: [0, 0, 1000]", "t: [0, 0, 1000", "broken YAML at line"),
        ("position: [0", "position: &a [0", None),
        ("t: [0, 0, 1000]", "t: &a [0, 0, 9]\n    up: *a", "found a YAML alias to line"),
    ],
)
def test_errors_name_file_camera_and_field(old, new, message, tmp_path):
    assert old in SHORT
    path = tmp_path / "rig.yaml"
    path.write_text(SHORT.replace(old, new, 1))
    if message is None:
        load_rig(path)  # an anchor alone does no harm
        return
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        load_rig(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "found an empty file"),
        (b"# only a comment\n", "found an empty file"),
        (b"- 1\n- 2\n", "found a list, expected a YAML mapping"),
        (b"text", "found text, expected a YAML mapping"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"a: \x00", "broken YAML"),
        (b"a: !!python/object:os.system x", "broken YAML"),
        (b"? [1, 2]\n: 3\n", "a key is not plain text"),
        (b"format: emission-rig\nversion: 1\n", "cameras: missing"),
        (b"format: emission-rig\nversion: 1\ncameras: []\n", "cameras: found none"),
        (b"format: emission-rig\nversion: 1\ncameras: [1]\n", r"cameras\[0\]: found 1, expected"),
        (b"#" * (2**24 + 1), "more than 16 MiB"),
    ],
)
def test_files_that_are_no_rig(content, message, tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        load_rig(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("format_line", "words"),
    [
        ("", "format: missing, expected emission-rig"),
        ("format: Emission-Rig\n", "format: found 'Emission-Rig', expected emission-rig"),
        ("fromat: emission-rig\n", "format: missing, expected emission-rig"),
    ],
)
def test_a_rig_that_lacks_its_format_is_not_taken_for_a_foreign_one(format_line, words, tmp_path):
    path = tmp_path / "rig.yaml"
    save_rig(preset("paper11_11deg"), path)
    path.write_text(path.read_text("utf-8").replace("format: emission-rig\n", format_line))
    with pytest.raises(ValueError, match=words):
        formats.load(path)


def test_python_places_a_camera_as_the_file_does(tmp_path):
    (tmp_path / "rig.yaml").write_text(SHORT)
    lens = {"image_size": (640, 480), "focal_length": 50, "pixel_pitch": 5e-3}
    placed = camera_at("left", (0, 0, 1000), (0, 0, 0), **lens)
    assert placed == load_rig(tmp_path / "rig.yaml")["left"]
    assert placed.optics == Optics(focal_length=50, pixel_pitch=5e-3)
    with pytest.raises(ValueError, match="camera left: pixel_pitch: found 0"):
        camera_at("left", (0, 0, 1000), (0, 0, 0), **lens | {"pixel_pitch": 0})
