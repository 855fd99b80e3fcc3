import json
import logging
import os
import re
from pathlib import Path

import numpy as np
import pytest

from rigs import formats, look_at
from rigs.formats.transforms import load_transforms, save_transforms

PROJECT = Path(__file__).parents[3]
DATA = Path(os.environ.get("TOMO_TEST_DATA", PROJECT.parent / "shared" / "data"))
INTRINSICS = {"w": 640, "h": 480, "fl_x": 500.0, "fl_y": 510.0, "cx": 320.0, "cy": 240.0}


def camera_to_world(position, target=(0, 0, 0)):
    """OpenGL's: columns are right, up and backward, then the position."""
    R, _ = look_at(position, target)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([R[0], -R[1], -R[2]], axis=1)
    matrix[:3, 3] = position
    return matrix.tolist()


def entry(path, position=(0, 0, 5), **more):
    return {"file_path": path, "transform_matrix": camera_to_world(position), **more}


def write(folder, data):
    path = folder / "transforms.json"
    path.write_text(json.dumps(data))
    return path


def test_axes_and_pixel_centres_are_converted(tmp_path):
    path = write(tmp_path, {**INTRINSICS, "frames": [entry("images/a/f0.png", (0, 0, 5))]})
    rig, frames = load_transforms(path)
    camera = rig["a"]
    np.testing.assert_allclose(camera.position, [0, 0, 5])
    uv, depth, valid = camera.project([[0, 0, 0], [0, 1, 0], [1, 0, 0]])
    # half-pixel (320, 240) is the corner shared by the four middle pixels: 319.5, 239.5 here
    np.testing.assert_allclose(uv, [[319.5, 239.5], [319.5, 137.5], [419.5, 239.5]])
    assert valid.all()
    np.testing.assert_allclose(depth, 5)
    assert frames == [("f0", {"a": tmp_path / "images/a/f0.png"})]
    assert camera.status == "calibrated"


def test_cameras_and_frames_come_from_folders(tmp_path):
    images = [
        entry(f"images/{name}/{frame}.png", position)
        for name, position in (("left", (0, 0, 5)), ("right", (5, 0, 0)))
        for frame in ("t0", "t1")
    ]
    rig, frames = load_transforms(write(tmp_path, {**INTRINSICS, "frames": images}))
    assert rig.names == ("left", "right")
    assert [(name, list(views)) for name, views in frames] == [
        ("t0", ["left", "right"]),
        ("t1", ["left", "right"]),
    ]


def test_the_entrys_own_camera_wins(tmp_path):
    images = [
        entry("x/t0.png", (0, 0, 5), camera="A"),
        entry("y/t0.png", (5, 0, 0), camera="B", fl_x=900.0),
    ]
    rig, frames = load_transforms(write(tmp_path, {**INTRINSICS, "frames": images}))
    assert rig.names == ("A", "B")
    assert rig["B"].camera_matrix[0, 0] == rig["B"].camera_matrix[1, 1] == 900
    assert rig["A"].camera_matrix[1, 1] == 510
    assert list(frames[0][1]) == ["A", "B"]


def check_message(error, path):
    assert str(error).startswith(f"{path}: ")
    assert "\n" not in str(error)


@pytest.mark.parametrize("folder", ["images/", ""])
def test_different_entries_of_one_folder_are_cameras_of_one_moment(folder, tmp_path):
    images = [entry(f"{folder}{i:03d}.png", (i, 0, 5)) for i in range(3)]
    rig, frames = load_transforms(write(tmp_path, {**INTRINSICS, "frames": images}))
    assert rig.names == ("000", "001", "002")
    assert [(name, list(views)) for name, views in frames] == [("transforms", list(rig.names))]


@pytest.mark.parametrize(
    ("lens", "model", "coefficients"),
    [
        ({}, "none", ()),
        ({"k1": 0.0, "p2": 0}, "none", ()),
        ({"k1": 0.1, "p2": 0.02}, "brown", (0.1, 0, 0, 0.02, 0)),
        ({"camera_model": "SIMPLE_RADIAL", "k1": 0.1}, "brown", (0.1, 0, 0, 0, 0)),
        ({"camera_model": "OPENCV", "k1": 1, "k2": 2, "k3": 3}, "brown", (1, 2, 0, 0, 3)),
        (
            {"camera_model": "FULL_OPENCV", **{f"k{i}": i for i in range(1, 7)}, "p1": 7, "p2": 8},
            "rational",
            (1, 2, 7, 8, 3, 4, 5, 6),
        ),
        ({"camera_model": "OPENCV_FISHEYE", "k4": 0.1}, "fisheye", (0, 0, 0, 0.1)),
        ({"is_fisheye": True, "k1": 0.1}, "fisheye", (0.1, 0, 0, 0)),
    ],
)
def test_lens_models(lens, model, coefficients, tmp_path):
    path = write(tmp_path, {**INTRINSICS, **lens, "frames": [entry("a/0.png")]})
    distortion = load_transforms(path)[0][0].distortion
    assert (distortion.model, distortion.coefficients) == (model, coefficients)


def test_an_image_size_serves_files_without_one(tmp_path):
    path = write(tmp_path, {"camera_angle_x": 0.69, "frames": [entry("./train/r_0")]})
    with pytest.raises(ValueError, match=r"frames\[0\] \(./train/r_0\): w: missing"):
        formats.load(path)
    camera = formats.load(path, image_size=(800, 600))[0]
    assert camera.image_size == (800, 600)
    assert camera.camera_matrix[0, 0] == pytest.approx(400 / np.tan(0.345))
    assert camera.camera_matrix[:2, 2].tolist() == [399.5, 299.5]


def test_rotations_that_passed_through_float32_are_mended(tmp_path):
    image = entry("a/0.png", (1, 2, 3))
    image["transform_matrix"] = np.round(image["transform_matrix"], 5).tolist()
    camera = load_transforms(write(tmp_path, {**INTRINSICS, "frames": [image]}))[0][0]
    np.testing.assert_allclose(camera.R @ camera.R.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(camera.position, [1, 2, 3], atol=1e-9)


def test_scales_are_reported_of(tmp_path, caplog):
    data = {**INTRINSICS, "scale": 0.33, "aabb_scale": 4, "frames": [entry("a/0.png")]}
    with caplog.at_level(logging.WARNING):
        load_transforms(write(tmp_path, data))
    assert "scale: found 0.33: not applied" in caplog.text
    caplog.clear()
    load_transforms(write(tmp_path, {**data, "scale": 1.0, "applied_scale": 1}))
    assert not caplog.text


def mirrored():
    matrix = np.array(camera_to_world((0, 0, 5)))
    matrix[:, 0] *= -1
    return matrix.tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"transform_matrix": None}, "transform_matrix: found nothing"),
        ({"transform_matrix": [[1, 2], [3, 4]]}, "transform_matrix: found [[1, 2], [3, 4]]"),
        ({"transform_matrix": mirrored()}, "transform_matrix: mirrored (determinant -1)"),
        ({"transform_matrix": np.diag([2, 2, 2, 1.0]).tolist()}, "transform_matrix: not ortho"),
        ({"transform_matrix": np.diag([1, 1, 1, 2.0]).tolist()}, "transform_matrix: found last"),
        ({"fl_x": float("nan")}, "fl_x: found nan, expected a finite number"),
        ({"fl_x": "wide"}, "fl_x: found 'wide', expected a finite number"),
        ({"w": 640.5}, "w: found 640.5"),
        ({"w": -1}, "w: found -1, expected a whole number"),
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model: found 'EQUIRECTANGULAR', expected"),
        ({"k4": 0.1}, "k4: found 0.1, expected 0 for camera_model OPENCV"),
        ({"camera_model": "PINHOLE", "k1": 0.1}, "k1: found 0.1, expected 0 for camera_model PIN"),
        ({"file_path": "."}, "file_path: found '.', expected an image's path"),
        ({"file_path": 5}, "file_path: found 5, expected an image's path"),
        ({"file_path": "b/0.png\n"}, r"file_path: found 'b/0.png\n', expected an image's path"),
        ({"camera": 3}, "camera: found 3, expected text"),
        ({"camera": "a/b"}, "camera name: found 'a/b'"),
    ],
)
def test_errors_name_file_entry_and_field(change, message, tmp_path):
    images = [entry("a/0.png"), {**entry("b/0.png"), **change}]
    path = write(tmp_path, {**INTRINSICS, "frames": images})
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        load_transforms(path)
    assert str(caught.value).startswith(f"{path}: ")
    if "camera" not in change:
        assert "frames[1]" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("path", "kept"),
    [
        ("../shots/a/0.png", "../shots/a/0.png"),
        ("a/../../a/0.png", "../a/0.png"),
        ("/data/a/0.png", "/data/a/0.png"),
        (r"C:\data\a\0.png", "C:/data/a/0.png"),
        (r"\\nas\data\a\0.png", "//nas/data/a/0.png"),
        (r".\a\0.png", "a/0.png"),
    ],
)
def test_a_rig_needs_no_image(path, kept, tmp_path):
    """Paths that lead elsewhere are kept for who opens images, and name cameras as others do."""
    images = [entry(path), entry("b/0.png", (5, 0, 0))]
    rig, frames = load_transforms(write(tmp_path, {**INTRINSICS, "frames": images}))
    assert rig.names == ("a", "b")
    assert frames == [("0", {"a": tmp_path / kept, "b": tmp_path / "b/0.png"})]


POSITIONS = {"left": (0, 0, 5), "right": (5, 0, 0), "top": (0, 5, 1)}


def flat(pattern, moments=(1, 2)):
    """Entries of fixed cameras in one folder at several moments."""
    return [
        entry(pattern.format(name=name, moment=moment), position)
        for moment in moments
        for name, position in POSITIONS.items()
    ]


@pytest.mark.parametrize(
    "pattern",
    ["images/{name}_{moment:04d}.png", "{name}-{moment}.png", r".\images\{name}{moment:03d}.jpg"],
)
def test_moments_of_fixed_cameras_in_one_folder(pattern, tmp_path):
    rig, frames = load_transforms(write(tmp_path, {**INTRINSICS, "frames": flat(pattern)}))
    assert rig.names == tuple(POSITIONS)
    assert [list(views) for _, views in frames] == [list(POSITIONS)] * 2
    assert [int(name) for name, _ in frames] == [1, 2]
    for name, position in POSITIONS.items():
        np.testing.assert_allclose(rig[name].position, position)


def test_one_camera_at_several_moments_without_a_folder(tmp_path):
    images = [entry(f"{moment:04d}.png") for moment in range(3)]
    rig, frames = load_transforms(write(tmp_path, {**INTRINSICS, "frames": images}))
    assert rig.names == ("camera",)
    assert [name for name, _ in frames] == ["0000", "0001", "0002"]


@pytest.mark.parametrize(
    "pattern",
    [
        "images/{name}_{moment:04d}_raw.png",  # no number at the end
        "images/{moment:04d}_{name}_7.png",  # the number is not the moment
        "images/x{moment}.png",  # one name for several cameras
    ],
)
def test_moments_that_names_do_not_tell_are_asked_for(pattern, tmp_path):
    path = write(tmp_path, {**INTRINSICS, "frames": flat(pattern)})
    with pytest.raises(
        ValueError, match=r"have the same pose and lens: are they moments"
    ) as error:
        load_transforms(path)
    check_message(error.value, path)


def test_a_list_without_its_object_is_read(tmp_path):
    images = [entry("a/0.png", **INTRINSICS), entry("b/0.png", (5, 0, 0), **INTRINSICS)]
    path = write(tmp_path, images).rename(tmp_path / "poses.json")
    assert formats.sniff(path) == "transforms"
    assert formats.load(path).names == ("a", "b")


def test_one_camera_has_one_set_of_parameters(tmp_path):
    images = [entry("a/0.png"), entry("b/0.png", (5, 0, 0)), entry("a/1.png", (0, 1, 5))]
    path = write(tmp_path, {**INTRINSICS, "frames": images})
    message = r"camera a: R: differs between a/0.png and a/1.png"
    with pytest.raises(ValueError, match=message):
        load_transforms(path)
    images = [entry("a/0.png", camera="c"), entry("a/0.jpg", camera="c")]
    path = write(tmp_path, {**INTRINSICS, "frames": images})
    with pytest.raises(ValueError, match="camera c: frame 0: found twice"):
        load_transforms(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty file"),
        (b"{", "broken JSON: .* line 1"),
        (b"3", "found 3, expected a JSON object"),
        (b"{}", "frames: found nothing, expected a list"),
        (b'{"frames": []}', "frames: found"),
        (b'{"frames": [3]}', r"frames\[0\]: found 3, expected a mapping"),
        (b'{"frames": [{"file_path": "a/0.png"}]}', "transform_matrix: missing"),
        (b"[" * 100000, "nested too deeply"),
        (b"\xff", "not UTF-8"),
    ],
)
def test_files_that_are_none(content, message, tmp_path):
    path = tmp_path / "transforms.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        load_transforms(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_real_plume():
    path = DATA / "scalarflow" / "transforms.json"
    if not path.exists():
        pytest.skip(f"real data absent: {path} (set TOMO_TEST_DATA)")
    rig, frames = load_transforms(path)
    assert rig.names == ("cam00", "cam01", "cam02", "cam03", "cam04")
    assert [name for name, _ in frames] == ["frame_060", "frame_090"]
    assert all(image.exists() for _, views in frames for image in views.values())
    middle = np.array([[0.32725, 0.32355, -0.25035]])
    for camera in rig:
        assert camera.image_size == (1080, 1920)
        uv, depth, valid = camera.project(middle)
        assert valid.all()
        assert camera.inside(uv).all()
        assert 1.0 < depth[0] < 1.5
        assert camera.project(np.add(middle, [0, 0.1, 0]))[0][0, 1] < uv[0, 1]  # smoke rises


@pytest.mark.parametrize("model", ["none", "brown", "rational", "fisheye"])
def test_rigs_come_back(make_rig, assert_same_views, tmp_path, model):
    rig = make_rig(model, "none")
    formats.save(rig, tmp_path / "transforms.json")
    assert formats.sniff(tmp_path / "transforms.json") == "transforms"
    assert_same_views(formats.load(tmp_path / "transforms.json"), rig)


def test_images_come_back(make_rig, tmp_path):
    rig = make_rig("brown", "none")
    frames = [
        (frame, {name: tmp_path / f"pictures/{name}/{frame}.png" for name in rig.names})
        for frame in ("t0", "t1")
    ]
    save_transforms(rig, tmp_path / "transforms.json", frames)
    assert load_transforms(tmp_path / "transforms.json")[1] == frames
    with pytest.raises(ValueError, match=r"file_path: found /else/a.png, expected a path inside"):
        save_transforms(rig, tmp_path / "transforms.json", [("t", {"cam0": Path("/else/a.png")})])


def test_what_the_format_lacks_is_refused(make_rig, tmp_path):
    for rig, message in (
        (make_rig("none", "tilted"), "camera cam1: distortion: found model tilted"),
        (make_rig("none", skew=0.1), r"camera cam0: camera_matrix: found skew 0\.1"),
    ):
        with pytest.raises(ValueError, match=message):
            formats.save(rig, tmp_path / "transforms.json")
