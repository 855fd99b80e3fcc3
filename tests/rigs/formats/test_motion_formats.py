"""Calibrations of motion capture and of robots, written here by their published definitions."""

import json
import re

import numpy as np
import pytest
from lens_formulas import TRUTHS, brown, double_sphere, fisheye, rational, unified

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


def sensor_yaml(truth, model, coefficients):
    """A sensor.yaml, with the camera's pose in the body."""
    return (
        "# General sensor definitions.\nsensor_type: camera\ncomment: VI-Sensor cam0\n\n"
        "# Sensor extrinsics wrt. the body-frame.\nT_BS:\n  cols: 4\n  rows: 4\n"
        f"  data: [{numbers(truth.camera_to_world()).replace(' ', ', ')}]\n\n"
        f"rate_hz: 20\nresolution: [640, 480]\ncamera_model: pinhole\n"
        f"intrinsics: [{truth.fx}, {truth.fy}, {truth.cx}, {truth.cy}] #fu, fv, cu, cv\n"
        f"distortion_model: {model}\ndistortion_coefficients: {list(coefficients)}\n"
    )


def test_euroc(assert_projects, tmp_path):
    k = (0.02, -0.01, 0.003, -0.001)
    given = [("radial-tangential", (-0.28, 0.07, 2e-4, 1e-5), brown(-0.28, 0.07, 2e-4, 1e-5)),
             ("equidistant", k, fisheye(*k))]  # fmt: skip
    for i, (truth, (model, values, _)) in enumerate(zip(TRUTHS, given, strict=False)):
        (tmp_path / f"mav0/cam{i}").mkdir(parents=True)
        (tmp_path / f"mav0/cam{i}/sensor.yaml").write_text(sensor_yaml(truth, model, values))
    (tmp_path / "mav0/imu0").mkdir()
    (tmp_path / "mav0/imu0/sensor.yaml").write_text("sensor_type: imu\nT_BS:\n  cols: 4\n")
    for path in (tmp_path, tmp_path / "mav0"):
        assert formats.sniff(path) == "euroc"
        rig = formats.load(path)
        assert (rig.names, rig.length_unit) == (("cam0", "cam1"), "m")
        for camera, truth, (_, _, lens) in zip(rig, TRUTHS, given, strict=False):
            assert_projects(camera, lambda p, t=truth, bend=lens: t.pixels(p, bend))
    assert formats.load(tmp_path / "mav0/cam1/sensor.yaml").names == ("cam1",)


BASALT = {
    "pinhole": ({}, lambda plane: plane),
    "kb4": ({"k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": -0.001},
            fisheye(0.02, -0.01, 0.003, -0.001)),
    "ds": ({"xi": -0.2, "alpha": 0.59}, double_sphere(-0.2, 0.59)),
    "eucm": ({"alpha": 0.62, "beta": 1.1}, unified(0.62, 1.1)),
    "ucm": ({"alpha": 0.6}, unified(0.6)),
    "pinhole-radtan8": (
        {"k1": 0.4, "k2": -0.3, "p1": 1e-3, "p2": -5e-4, "k3": 0.02, "k4": 0.6, "k5": -0.1,
         "k6": 0.01, "rpmax": 2.7},
        rational(0.4, -0.3, 1e-3, -5e-4, 0.02, 0.6, -0.1, 0.01),
    ),
}  # fmt: skip


def quaternion(axis, angle):
    """The quaternion of a turn, and its matrix by Rodrigues' formula."""
    x, y, z = axis = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    qx, qy, qz = (axis * np.sin(angle / 2)).tolist()
    return {"qx": qx, "qy": qy, "qz": qz, "qw": float(np.cos(angle / 2))}, matrix


def basalt(kinds=tuple(BASALT)):
    """A calibration.json, and the pixels of points by its numbers."""
    poses, lenses, formulas = [], [], []
    for index, kind in enumerate(kinds):
        turned, R = quaternion((1, -2, 0.5 * index), 0.3 + index)
        position = np.array([0.1 * index, -0.2, 0.05])
        poses.append({**dict(zip(("px", "py", "pz"), position.tolist(), strict=True)), **turned})
        values, lens = BASALT[kind]
        K = {"fx": 651.5 + index, "fy": 649.0, "cx": 321.3, "cy": 238.4}
        lenses.append({"camera_type": kind, "intrinsics": {**K, **values}})

        def formula(points, R=R, position=position, K=K, lens=lens):
            x, y, z = R.T @ (points - position).T
            return lens(np.stack([x / z, y / z], axis=1)) * [K["fx"], K["fy"]] + [K["cx"], K["cy"]]

        formulas.append(formula)
    data = {"T_imu_cam": poses, "intrinsics": lenses, "resolution": [[640, 480]] * len(kinds),
            "cam_time_offset_ns": 0}  # fmt: skip
    return {"value0": data}, formulas


@pytest.mark.parametrize("kind", BASALT)
def test_basalt(assert_projects, tmp_path, kind):
    data, formulas = basalt((kind,))
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(data))
    assert formats.sniff(path) == "basalt"
    (camera,) = formats.load(path)
    assert camera.has_lens_model == (kind not in ("ds", "eucm", "ucm"))
    if camera.has_lens_model:
        assert_projects(camera, formulas[0])
    else:  # a table holds the rays of pixels' centres
        uv = np.random.default_rng(7).integers(0, camera.image_size, (200, 2))
        origins, directions = camera.rays(uv.astype(float))
        np.testing.assert_allclose(formulas[0](origins + 300 * directions), uv, rtol=0, atol=1e-6)


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
        ("sensor.yaml", sensor_yaml(TRUTHS[0], "fov", (1, 2, 3, 4)), "x", "x",
         "distortion_model: found 'fov', expected one of radial-tangential, radtan, equidistant"),
        ("a.json", json.dumps(basalt()[0]), '"kb4"', '"fov"', "camera cam1: camera_type: found"),
        ("a.json", json.dumps(basalt()[0]), '"xi": -0.2', '"xi": 1e200', "camera cam2: "),
        ("a.json", json.dumps(basalt()[0]), '"qw"', '"w"', "camera cam0: qw: missing"),
        ("a.json", json.dumps(basalt()[0]), "[640, 480], ", "", "T_imu_cam, intrinsics, res"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, name, text, old, new, message):
    path = tmp_path / name
    path.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        formats.load(path)
    assert str(error.value).startswith(str(path))
