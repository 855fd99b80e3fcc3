"""Bundler, VisualSFM and MVSNet, by their own formulas."""

import logging
import re

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rigs import formats, look_at
from rigs.formats import bundler, mvsnet, nvm

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


def model(k=0.0, fixed="", r9t=False, focal=(800.0, 810.0, 820.0)):
    lines = [("NVM_V3_R9T" if r9t else "NVM_V3") + fixed, "", "3"]
    for name, f, (R, t) in zip(NAMES, focal, POSES, strict=True):
        x, y, z, w = Rotation.from_matrix(R).as_quat()
        pose = row([*R.ravel(), *t]) if r9t else row([w, x, y, z, *(-R.T @ t)])
        lines.append(f"{name} {f!r} {pose} {k!r} 0")
    return "\n".join([*lines, "", "1", "1 2 3 255 0 0 1 0 5 1.5 2.5", "", "0"]) + "\n"


def nvm_misfit(camera, f, k, pose, centre=(320, 240)):
    """Pixels between p (1 + k |p|^2) of the pixels that see points, and the points' pinhole."""
    R, t = pose
    uv = np.random.default_rng(0).integers([0, 0], SIZE, (200, 2)).astype(float)
    origins, directions = camera.rays(uv)
    x = (origins + directions * np.linspace(100, 600, 200)[:, None]) @ R.T + t
    p = (uv + 0.5 - centre) / f  # its centres are at halves
    bent = p * (1 + k * np.sum(p**2, axis=1, keepdims=True))
    return np.abs(bent - x[:, :2] / x[:, 2:]).max() * f


def write_images(folder, size=SIZE, ending=".png", names=NAMES):
    folder.mkdir(exist_ok=True)
    for name in names:
        image = np.zeros(size[::-1], np.uint8)
        cv2.imwrite(str((folder / name).with_suffix(ending)), image)


def cam(R, t, K, depths="425.0 2.5"):
    E = np.vstack([np.column_stack([R, t]), [0, 0, 0, 1]])
    rows = "\n".join(map(row, E)), "\n".join(map(row, K))
    return f"extrinsic\n{rows[0]}\n\nintrinsic\n{rows[1]}\n\n{depths}\n"


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
    assert "f is 0 for camera1: 1 of 3 images, which were not oriented" in caplog.text
    file.write_text(bundle(focal=(0.0, 0.0)))
    with pytest.raises(ValueError, match="f: found 0 in all images"):
        formats.load(file, image_size=SIZE)


@pytest.mark.parametrize("r9t", [False, True])
@pytest.mark.parametrize("k", [0.0, 0.15])
def test_visualsfm_sees_as_its_documentation_says(tmp_path, r9t, k):
    write_images(tmp_path, ending=".jpg")
    file = tmp_path / "a.nvm"
    file.write_text(model(k, r9t=r9t).replace(".png", ".jpg"))
    assert formats.sniff(file) == "nvm"
    rig = formats.load(file)
    assert rig.names == ("a", "b", "c")
    for camera, f, pose in zip(rig, (800, 810, 820), POSES, strict=True):
        assert nvm_misfit(camera, f, k, pose) < 1e-6
        np.testing.assert_allclose(camera.position, -pose[0].T @ pose[1], atol=1e-6)
        assert camera.project(POINTS)[2].all()


def test_a_lens_is_fitted_to_what_visualsfm_bends_and_its_error_said(tmp_path, caplog):
    """A table of rays takes 50 bytes a pixel: gigabytes for a few images of 6 megapixels."""
    file = tmp_path / "a.nvm"
    file.write_text(model(-0.12, focal=(2600.0,) * 3))
    with caplog.at_level(logging.WARNING):
        rig = formats.load(file, image_size=(3072, 2048))
    assert all(camera.has_lens_model for camera in rig)
    assert "k: a lens of rig.yaml was fitted, to " in caplog.text


def test_bends_that_no_lens_fits_become_tables_of_rays(tmp_path):
    """At this k the image folds inside its corners."""
    file = tmp_path / "a.nvm"
    file.write_text(model(-1.5))
    rig = formats.load(file, image_size=SIZE)
    assert not any(camera.has_lens_model for camera in rig)


def test_a_fixed_calibration_holds_for_all_images(tmp_path):
    file = tmp_path / "a.nvm"
    file.write_text(model(fixed=" FixedK 800 330 805 250", focal=(800.0,) * 3))
    rig = formats.load(file, image_size=SIZE)
    for camera in rig:
        assert camera.camera_matrix.tolist() == [[800, 0, 329.5], [0, 805, 249.5], [0, 0, 1]]


def test_names_of_other_machines_and_further_models(tmp_path, caplog):
    text = model().replace("a.png", 'C:\\my"scan\\a"1.png').replace("b.png", "/data/b.png")
    text = text.replace("c.png", "../up/c.png")
    text = text[:-2] + "\n".join(model().splitlines()[2:]) + "\n"
    file = tmp_path / "a.nvm"
    file.write_text(text)
    with caplog.at_level(logging.WARNING):
        rig = formats.load(file, image_size=SIZE)
    assert rig.names == ("a 1", "b", "c")  # and not looked for outside the file's folder
    assert "a further model, of 3 images, is left out" in caplog.text


@pytest.mark.parametrize("depths", ["425.0 2.5", "425.0 2.5 192 902.5"])
def test_mvsnet_projects_as_its_matrices_say(tmp_path, depths):
    write_images(tmp_path / "images", names=[f"{i:08}.png" for i in range(3)], ending=".jpg")
    (tmp_path / "cams").mkdir()
    (tmp_path / "cams" / "pair.txt").write_text("3\n0\n2 1 0.5 2 0.4\n")
    K = np.array([[800, 0.5, 331.0], [0, 810, 244.0], [0, 0, 1]])
    for number, (R, t) in enumerate(POSES):
        (tmp_path / "cams" / f"{number:08}_cam.txt").write_text(cam(R, t, K, depths))
    rig = formats.load(tmp_path / "cams")
    assert formats.sniff(tmp_path / "cams") == "mvsnet"
    assert rig.names == ("00000000", "00000001", "00000002")
    for camera, (R, t) in zip(rig, POSES, strict=True):
        image = (POINTS @ R.T + t) @ K.T
        expected = image[:, :2] / image[:, 2:] - 0.5  # its centres are at halves
        np.testing.assert_allclose(camera.project(POINTS)[0], expected, rtol=0, atol=1e-6)
        assert camera.image_size == SIZE
    one = formats.load(tmp_path / "cams" / "00000001_cam.txt")
    assert one.cameras == (rig[1],)


def test_mvsnets_intrinsics_of_smaller_images_are_found_out(tmp_path):
    write_images(tmp_path, names=["00000000.png"])
    K = np.array([[200, 0, 80.0], [0, 200, 60.0], [0, 0, 1]])
    file = tmp_path / "00000000_cam.txt"
    file.write_text(cam(*POSES[0], K))
    message = "intrinsic: found principal point 80, 60 in"
    with pytest.raises(ValueError, match=f"camera 00000000: {message}.*--image-size"):
        formats.load(file)
    assert formats.load(file, image_size=(160, 120))[0].image_size == (160, 120)


CAM = cam(np.eye(3), [0, 0, 5], [[90, 0, 32], [0, 90, 24], [0, 0, 1]])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("bundler", "# Bundle file v0.3\nx 1\n", "number of cameras: found 'x', expected a"),
        ("bundler", "# Bundle file v0.3\n2 0\n800 0 0\n", "image camera0: found the file's end"),
        ("bundler", bundle().replace("800.0", "wide", 1), "image camera0: f: found 'wide'"),
        ("bundler", bundle().replace("800.0", "-8", 1), "image camera0: camera_matrix: found foc"),
        (
            "nvm",
            "NVM_V3\n4\n" + "\n".join(model().splitlines()[3:6]),
            "number of cameras: found 4",
        ),
        ("nvm", "NVM_V3 FixedX 1\n1\n", "found 'FixedX 1', expected FixedK fx cx fy cy"),
        ("nvm", "NVM_V3\n1\na.png 1 2\n", "found 'a.png 1 2', expected an image's name, f, its"),
        ("nvm", model(fixed=" FixedK 800 330 805 250"), "image b.png: f: found 810.0, expected 8"),
        ("nvm", model().replace(" 0.0 0\n", " 0.0 1\n", 1), "image a.png: found 1 at the end of"),
        ("mvsnet", CAM.replace("intrinsic", "K"), "camera a: found 'extrinsic 1.0"),
        ("mvsnet", CAM.replace("90.0", "x", 1), "camera a: K00: found 'x', expected a finite"),
        ("mvsnet", CAM + "1 2 3\n", "camera a: found 5 values, expected 4: DEPTH_MIN DEPTH_INT"),
        (
            "mvsnet",
            CAM.replace("0.0 0.0 0.0 1.0", "0.0 0.0 0.0 2.0"),
            "camera a: extrinsic: found",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path, name, text, message):
    file = tmp_path / "a.txt"
    file.write_text(text)
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        formats.load(file, name, image_size=SIZE)
    assert str(error.value).startswith(f"{file}: {message}")
    assert len(str(error.value).splitlines()) == 1


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=90)
def test_broken_files_are_refused_or_read(read_or_refused, damaged, tmp_path, data):
    module, text = data.draw(st.sampled_from([(bundler, bundle()), (nvm, model()), (mvsnet, CAM)]))
    file = tmp_path / "a.txt"
    file.write_text(damaged(text, data))
    rig = read_or_refused(lambda path: module.load(path, SIZE), file)
    assert rig is None or len(rig)
