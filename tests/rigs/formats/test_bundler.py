"""Bundler, by its manual's formula."""

import logging

import cv2
import numpy as np
import pytest

from rigs import formats, look_at

SIZE = (640, 480)
POINTS = np.random.default_rng(0).uniform(-30, 30, (200, 3))
PLACES = [(300, 40, 200), (-250, 60, 260), (20, -80, 350)]
POSES = [look_at(place, (0, 0, 0)) for place in PLACES]
NAMES = ("a.png", "b.png", "c.png")


def row(values):
    return " ".join(repr(float(v)) for v in np.ravel(values))


def bundle(focal=(800.0, 810.0, 820.0), k=(-0.1, 0.05)):
    lines = ["# Bundle file v0.3", f"{len(focal)} 1"]
    for f, (R, t) in zip(focal, POSES, strict=False):
        turn = np.diag([1.0, -1, -1])  # its cameras look along -z, y up
        lines += [row([f, *k] if f else [0, 0, 0])]
        lines += [row(r) for r in (turn @ R if f else np.eye(3) * 0 + np.eye(3))]
        lines += [row(turn @ t if f else [0, 0, 0])]
    return "\n".join([*lines, "1.0 2.0 3.0", "255 0 0", "1 0 5 1.5 2.5"]) + "\n"


def bundler_pixels(f, k, R, t):
    """Columns and rows by Bundler's manual, in our count."""
    P = POINTS @ (np.diag([1.0, -1, -1]) @ R).T + np.diag([1.0, -1, -1]) @ t
    p = -P[:, :2] / P[:, 2:]
    q = np.sum(p**2, axis=1, keepdims=True)
    p = f * (1 + k[0] * q + k[1] * q**2) * p
    # from the middle of the image, y up; the middle of 640 columns lies between 319 and 320
    return np.stack([319.5 + p[:, 0], 239.5 - p[:, 1]], axis=-1)


def write_images(folder, size=SIZE, ending=".png", names=NAMES):
    folder.mkdir(exist_ok=True)
    for name in names:
        image = np.zeros(size[::-1], np.uint8)
        cv2.imwrite(str((folder / name).with_suffix(ending)), image)


def test_bundler_projects_as_its_manual_says(tmp_path):
    write_images(tmp_path)
    (tmp_path / "list.txt").write_text("".join(f"{name} 0 800.0\n" for name in NAMES))
    (tmp_path / "bundle").mkdir()
    file = tmp_path / "bundle" / "bundle.out"
    file.write_text(bundle())
    assert formats.sniff(file) == "bundler"
    rig = formats.load(file)
    assert rig.names == ("a", "b", "c")
    for camera, f, pose in zip(rig, (800, 810, 820), POSES, strict=True):
        uv, depth, valid = camera.project(POINTS)
        assert valid.all()
        assert (depth > 0).all()
        np.testing.assert_allclose(uv, bundler_pixels(f, (-0.1, 0.05), *pose), rtol=0, atol=1e-6)
        assert camera.image_size == SIZE


def test_bundler_without_a_list_asks_for_sizes(tmp_path):
    file = tmp_path / "bundle.out"
    file.write_text(bundle(k=(0, 0)))
    with pytest.raises(ValueError, match=r"image camera0: image_size: missing, as Bundler files"):
        formats.load(file)
    rig = formats.load(file, image_size=SIZE)
    assert rig.names == ("camera0", "camera1", "camera2")
    assert all(camera.is_pinhole for camera in rig)


def test_images_that_bundler_did_not_orient_are_named(tmp_path, caplog):
    file = tmp_path / "bundle.out"
    file.write_text(bundle(focal=(800.0, 0.0, 820.0)))
    with caplog.at_level(logging.WARNING):
        rig = formats.load(file, image_size=SIZE)
    assert rig.names == ("camera0", "camera2")
    assert "left out 1 views without a pose" in caplog.text
    file.write_text(bundle(focal=(0.0, 0.0)))
    with pytest.raises(ValueError, match="found a pose of none of 2 views"):
        formats.load(file, image_size=SIZE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# Bundle file v0.3\nx 1\n", "number of cameras: found 'x', expected a"),
        ("# Bundle file v0.3\n2 0\n800 0 0\n", "image camera0: found the file's end"),
        (bundle().replace("800.0", "wide", 1), "image camera0: f: found 'wide'"),
        (bundle().replace("800.0", "-8", 1), "image camera0: camera entry: camera_matrix: "),
    ],
)
def test_what_is_wrong_is_named(refused_as, tmp_path, text, message):
    file = tmp_path / "a.txt"
    file.write_text(text)
    refused_as(file, message, file, "bundler", image_size=SIZE)
