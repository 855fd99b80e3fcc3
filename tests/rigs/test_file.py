import dataclasses
import os
import re

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from rigs import (
    Camera,
    Distortion,
    Optics,
    Rig,
    Volume,
    formats,
    load_rig,
    look_at,
    preset,
    ring,
    save_rig,
)
from rigs.file import rig_to_yaml

COUNTS = {"none": 0, "brown": 5, "rational": 8, "thin_prism": 12, "tilted": 14, "fisheye": 4}
EVERYWHERE = settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150
)

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


def random_rig(seed):
    rng = np.random.default_rng(seed)
    cameras = []
    for index, (model, count) in enumerate(COUNTS.items()):
        R, t = look_at(rng.normal(size=3) * 1e3, rng.normal(size=3))
        K = [[rng.uniform(1, 1e5), 0, rng.normal()], [0, rng.uniform(1, 1e5), 1e-7], [0, 0, 1]]
        lens = Distortion(model, tuple(rng.normal(size=count) * 10.0 ** rng.integers(-9, 0)))
        optics = Optics(f_number=2.8, focal_length=rng.uniform(1, 99)) if index % 2 else None
        status = ("calibrated", "nominal", "virtual")[index % 3]
        cameras.append(Camera(f"cam{index}", (640, 480), K, lens, R, t, optics, status))
    calibration = {"date": "2024-05-01", "ray_miss": {"rms": 0.1 + 0.2}, "list": [1, [2.5], "no"]}
    volume = Volume((3, 4, 5), rng.uniform(0.1, 1, 3), rng.normal(size=3))
    return Rig(tuple(cameras), "mm", "y up: 'x' µm # no comment", volume, calibration)


def check_message(error, path):
    assert str(error).startswith(f"{path}: ")
    assert "\n" not in str(error)


@given(seed=st.integers(0, 2**32 - 1))
@settings(EVERYWHERE, max_examples=20)
def test_a_rig_comes_back_bit_by_bit(seed, tmp_path):
    rig = random_rig(seed)
    save_rig(rig, tmp_path / "rig.yaml")
    assert load_rig(tmp_path / "rig.yaml") == rig
    assert os.listdir(tmp_path) == ["rig.yaml"]  # no temporary file is left


@given(text=st.text(max_size=30))
@settings(EVERYWHERE)
@example(text="line\nbreak: \t{")
@example(text="null")
@example(text="é\x85\u2028")
def test_any_text_comes_back(text, tmp_path):
    rig = dataclasses.replace(random_rig(0)[:1], world_frame=text, calibration={"note": [text]})
    try:
        save_rig(rig, tmp_path / "rig.yaml")
    except UnicodeEncodeError:
        pytest.fail("text that cannot be written")
    assert load_rig(tmp_path / "rig.yaml") == rig


def test_opencv_reads_what_is_written(tmp_path):
    rig = random_rig(1)
    save_rig(rig, tmp_path / "rig.yaml")
    storage = cv2.FileStorage(str(tmp_path / "rig.yaml"), cv2.FILE_STORAGE_READ)
    assert storage.getNode("format").string() == "emission-rig"
    assert storage.getNode("world_frame").string() == rig.world_frame
    cameras = storage.getNode("cameras")
    assert cameras.size() == len(rig)

    def numbers(node):
        if node.isSeq():
            return [numbers(node.at(i)) for i in range(node.size())]
        return node.real()

    for index, camera in enumerate(rig):
        node = cameras.at(index)
        assert node.getNode("name").string() == camera.name
        assert numbers(node.getNode("image_size")) == list(camera.image_size)
        lens = node.getNode("distortion")
        assert lens.getNode("model").string() == camera.distortion.model
        for name, expected in (
            ("camera_matrix", camera.camera_matrix),
            ("R", camera.R),
            ("t", camera.t),
        ):
            np.testing.assert_allclose(numbers(node.getNode(name)), expected, rtol=1e-14)
        np.testing.assert_allclose(
            numbers(lens.getNode("coefficients")), camera.distortion.coefficients, rtol=1e-14
        )
    assert numbers(storage.getNode("volume").getNode("shape")) == [3, 4, 5]


def test_what_is_written_is_plain_yaml():
    data = yaml.safe_load(rig_to_yaml(random_rig(2)))
    assert list(data)[:6] == [
        "format",
        "version",
        "length_unit",
        "convention",
        "world_frame",
        "cameras",
    ]
    assert (data["format"], data["version"], data["convention"]) == ("emission-rig", 1, "opencv")
    for camera in data["cameras"]:
        assert np.shape(camera["camera_matrix"]) == np.shape(camera["R"]) == (3, 3)
        assert np.shape(camera["t"]) == (3,)


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
        (
            "pixel_pitch: 5e-3",
            "pixel_pich: 5e-3",
            "pixel_pich: unknown field, did you mean pixel_pi",
        ),
        ("up: [0, 1, 0]", "up: [0, 0, 1]", "camera left: up: found [0.0, 0.0, 1.0], expected a"),
        ("up: [0, 1, 0]", "R: [1]", "camera left: R[0]: found 1, expected a list"),
        ("name: right", "name: left", "camera left: name: found twice"),
        ("name: right", "name: 7", "cameras[1]: name: found 7, expected text"),
        ("name: right", "label: right", "cameras[1]: label: unknown field"),
        (
            "[640, 480]\n    camera",
            "[640, 4.5]\n    camera",
            "camera right: image_size[1]: found 4.5",
        ),
        (
            "[640, 480]\n    camera",
            "[640]\n    camera",
            "camera right: image_size: found 1 value, expected a list of 2",
        ),
        ("[640, 480]\n    camera", "[0, 1]\n    camera", "camera right: image_size: found (0, 1)"),
        ("spacing: 0.5", "spacing: [1, 2]", "volume.spacing"),
        ("spacing: 0.5", "spacing: 0", "volume.spacing: found 0.0, expected positive"),
        ("shape: [4, 5, 6]", "shape: [4, 5, 0]", "volume.shape"),
        ("volume:", "volumes:", "volumes: unknown field, did you mean volume?"),
        ("cameras:", "cameras: []\nother:", "other: unknown field"),
        (
            "version: 1",
            "version: 1\nversion: 1",
            "version: found twice in one mapping, again at line 3",
        ),
        (
            "version: 1",
            "version: 1\nconvention: opengl",
            "convention: found 'opengl', expected op",
        ),
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
        (b"a: " + b"[" * 5000, "broken YAML"),
        (b"a: " + b"[" * 500 + b"]" * 500, "nested too deeply"),
        (b"a: !!python/object:os.system x", "broken YAML"),
        (b"a: " + b"9" * 9999, "broken YAML"),
        (b"? [1, 2]\n: 3\n", "a key is no plain text"),
        (b"format: emission-rig\nversion: 1\n", "cameras: missing"),
        (b"format: emission-rig\nversion: 1\ncameras: []\n", "cameras: found none"),
        (
            b"format: emission-rig\nversion: 1\ncameras: [1]\n",
            r"cameras\[0\]: found 1, expected a mapping",
        ),
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


def test_a_laughing_file_is_refused_at_once(tmp_path):
    lines = ["a0: &a0 [0, 0]"] + [f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 60)]
    (tmp_path / "rig.yaml").write_text("\n".join(lines))
    with pytest.raises(ValueError, match=r"alias|nested too deeply"):
        load_rig(tmp_path / "rig.yaml")


@given(data=st.binary(max_size=200))
@EVERYWHERE
def test_random_bytes_give_only_an_error_that_names_the_file(data, tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=re.escape(str(path))):
        load_rig(path)


@given(
    edits=st.lists(
        st.tuples(st.integers(0, len(SHORT)), st.integers(0, 6), st.text(max_size=4)),
        min_size=1,
        max_size=4,
    )
)
@settings(EVERYWHERE, max_examples=300)
def test_a_damaged_file_loads_or_gives_an_error_that_names_it(edits, tmp_path):
    text = SHORT
    for place, removed, added in edits:
        text = text[:place] + added + text[place + removed :]
    path = tmp_path / "rig.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        rig = load_rig(path)
    except ValueError as error:
        check_message(error, path)
    else:
        save_rig(rig, tmp_path / "again.yaml")
        assert load_rig(tmp_path / "again.yaml") == rig


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)


@given(data=st.data(), junk=JUNK)
@settings(EVERYWHERE, max_examples=300)
def test_junk_in_any_field_loads_or_gives_an_error_that_names_the_file(data, junk, tmp_path):
    content = yaml.safe_load(SHORT)
    here = content
    while True:  # walk to a random place
        key = data.draw(
            st.sampled_from(list(here) if isinstance(here, dict) else range(len(here)))
        )
        if not isinstance(here[key], (dict, list)) or not here[key] or data.draw(st.booleans()):
            break
        here = here[key]
    here[key] = junk
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    try:
        load_rig(path)
    except ValueError as error:
        check_message(error, path)


def test_a_failed_save_leaves_the_old_file(tmp_path):
    path = tmp_path / "rig.yaml"
    rig = ring(2, distance=5, image_size=(4, 4), footprint=1)
    save_rig(rig, path)
    before = path.read_text()
    with pytest.raises(ValueError, match=r"calibration\.when: found ndarray, expected plain"):
        save_rig(dataclasses.replace(rig, calibration={"when": np.zeros(2)}), path)
    assert path.read_text() == before
    assert os.listdir(tmp_path) == ["rig.yaml"]


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
