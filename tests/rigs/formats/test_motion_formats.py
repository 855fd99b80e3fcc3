"""Calibrations of motion capture and of KITTI, written here by their published definitions."""

import numpy as np
import pytest
from lens_formulas import TRUTHS, brown

from rigs import formats

LENS = {"k1": -0.12, "k2": 0.05, "p1": 0.001, "p2": -0.002, "k3": 0.03}


def numbers(values):
    return " ".join(repr(float(v)) for v in np.ravel(values))


def qualisys(transposed=False, left=0):
    """A .qca.txt: subpixels of the whole sensor, axes right, up and back as rows."""
    cameras = []
    for number, truth in enumerate(TRUTHS):
        axes = np.stack([truth.right, -truth.down, -truth.forward])
        axes = (axes.T if transposed else axes).tolist()
        r = " ".join(f'r{i + 1}{j + 1}="{axes[i][j]}"' for i in range(3) for j in range(3))
        x, y, z = truth.centre.tolist()
        cameras.append(
            f'<camera active="1" serial="2{number}" model="none" viewrotation="0">'
            f'<fov_video left="{left}" top="0" right="{left + 639}" bottom="479"/>'
            f'<transform x="{x}" y="{y}" z="{z}" {r}/>'
            f'<intrinsic focallength="9" skew="0" focalLengthU="{truth.fx * 64}" '
            f'focalLengthV="{truth.fy * 64}" centerPointU="{(truth.cx + left) * 64}" '
            f'centerPointV="{truth.cy * 64}" radialDistortion1="{LENS["k1"]}" '
            f'radialDistortion2="{LENS["k2"]}" radialDistortion3="{LENS["k3"]}" '
            f'tangentalDistortion1="{LENS["p1"]}" tangentalDistortion2="{LENS["p2"]}"/></camera>'
        )
    text = "<?xml version='1.0'?>\n<calibration type=\"regular\"><cameras>"
    return text + "".join(cameras) + "</cameras></calibration>"


@pytest.mark.parametrize(("left", "transposed"), [(0, False), (128, False), (0, True)])
def test_qualisys(assert_projects, tmp_path, caplog, left, transposed):
    path = tmp_path / "calibration.qca.txt"
    path.write_text(qualisys(transposed, left))
    assert formats.sniff(path) == "qualisys"
    rig = formats.load(path)
    assert rig.names == ("20", "21", "22")
    assert rig.length_unit == "mm"
    assert ("are read as columns" in caplog.text) is transposed
    for camera, truth in zip(rig, TRUTHS, strict=True):
        assert camera.image_size == truth.size
        assert_projects(camera, lambda points, t=truth: t.pixels(points, brown(**LENS)))


def test_qualisys_names_cameras_that_it_leaves_out_or_that_are_turned(tmp_path, caplog):
    text = qualisys().replace('active="1"', 'active="0"', 1)
    path = tmp_path / "calibration.qca.txt"
    path.write_text(text.replace('viewrotation="0"', 'viewrotation="90"'))
    assert formats.load(path).names == ("21", "22")
    assert "left out cameras that are not active: 20" in caplog.text
    assert "pixels are taken as on the sensor, not turned: 21, 22" in caplog.text


def kitti():
    """A calib_cam_to_cam.txt: poses from camera 0, whose axes are the world."""
    first, lines = TRUTHS[0], ["calib_time: 09-Jan-2012 13:57:47", "corner_dist: 9.95e-02"]
    for number, truth in enumerate(TRUTHS):
        K = [truth.fx, 0, truth.cx, 0, truth.fy, truth.cy, 0, 0, 1]
        motion = np.linalg.inv(truth.camera_to_world()) @ first.camera_to_world()
        D = [LENS[key] for key in ("k1", "k2", "p1", "p2", "k3")]
        lines += [
            f"S_{number:02}: {numbers(truth.size)}",
            f"K_{number:02}: {numbers(K)}",
            f"D_{number:02}: {numbers(D)}",
            f"R_{number:02}: {numbers(motion[:3, :3])}",
            f"T_{number:02}: {numbers(motion[:3, 3])}",
            f"S_rect_{number:02}: 600 400",
        ]
    return "\n".join(lines) + "\n"


def test_kitti(assert_projects, tmp_path, caplog):
    path = tmp_path / "calib_cam_to_cam.txt"
    path.write_text(kitti())
    assert formats.sniff(path) == "kitti"
    rig = formats.load(path)
    assert rig.names == ("image_00", "image_01", "image_02")
    assert "cameras of the images as taken" in caplog.text
    to_world = TRUTHS[0].camera_to_world()
    for camera, truth in zip(rig, TRUTHS, strict=True):

        def formula(points, truth=truth):
            world = points @ to_world[:3, :3].T + to_world[:3, 3]
            return truth.pixels(world, brown(**LENS))

        assert_projects(camera, formula)


def test_kitti_rectified(assert_projects, tmp_path):
    path = tmp_path / "calib.txt"
    P = [np.array([[718.9, 0, 607.2, -shift * 718.9], [0, 718.9, 185.2, 0.3], [0, 0, 1, 0.002]])
         for shift in (0, 0.54, -0.06, 0.47)]  # fmt: skip
    path.write_text("".join(f"P{i}: {numbers(p)}\n" for i, p in enumerate(P)) + "Tr: 1 0 0 0\n")
    with pytest.raises(ValueError, match=r"image_size: missing, as KITTI's rectified files hold"):
        formats.load(path)
    for camera, p in zip(formats.load(path, image_size=(1241, 376)), P, strict=True):

        def formula(points, p=p):
            image = points @ p[:, :3].T + p[:, 3]
            return image[:, :2] / image[:, 2:]

        assert_projects(camera, formula)


@pytest.mark.parametrize(
    ("name", "text", "old", "new", "message"),
    [
        ("a.qca.txt", qualisys(), "focalLengthU=", "lengthU=",
         "nearest is qualisys (Qualisys Track Manager's .qca.txt): lacks focalLengthU"),
        ("a.qca.txt", qualisys(), 'right="639"', 'right="wide"',
         "camera 20: fov_video right: found 'wide', expected a finite number"),
        ("a.qca.txt", qualisys(), "<transform", "<moved", "camera 20: transform: missing"),
        ("a.qca.txt", qualisys(), 'active="1"', 'active="0"', "cameras: found 3, none active"),
        ("calib.txt", kitti(), "S_01: 640.0 480.0", "S_01: 640", "camera image_01: S_01: found"),
        ("calib.txt", kitti(), "T_02:", "X_02:", "camera image_02: T_02: missing"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(refused_as, tmp_path, name, text, old, new, message):
    path = tmp_path / name
    path.write_text(text.replace(old, new))
    refused_as(path, message, path)
