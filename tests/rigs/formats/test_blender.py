"""Lists of Blender's cameras, against the view plane that Blender itself computes."""

import json
import math
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigs import formats, look_at
from rigs.formats import blender

WIDE = {"lens": 35.0, "sensor_width": 36.0, "resolution_x": 640, "resolution_y": 480}
CAMERAS = [
    {"name": "wide", **WIDE},
    {"name": "shifted", **WIDE, "shift_x": 0.03, "shift_y": -0.05, "lens": 50.0},
    {"name": "tall", **WIDE, "resolution_x": 480, "resolution_y": 640, "shift_y": 0.02},
    {"name": "fitted", **WIDE, "sensor_fit": "VERTICAL", "sensor_height": 24.0, "shift_x": 0.02},
    {"name": "stretched", **WIDE, "pixel_aspect_y": 1.6, "shift_y": 0.04},
    {"name": "flat", **WIDE, "sensor_fit": "HORIZONTAL", "resolution_x": 300},
    {"name": "halved", **WIDE, "resolution_percentage": 50},
    {"name": "by_angle", "angle_x": 0.8, "width": 640, "height": 480},
]


def pose(seed):
    """A camera-to-world matrix, axes x right, y up, z backward."""
    rng = np.random.default_rng(seed)
    position = rng.normal(size=3) * 300
    R, _ = look_at(position, rng.normal(size=3) * 5)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = (np.diag([1, -1, -1]) @ R).T, position
    return matrix


def pixels(points, matrix, c):
    """Pixels, (0.5, 0.5) the middle of the top-left one, by BKE_camera_params_compute_viewplane.

    The view plane lies at distance one here, where Blender takes the clipping distance.
    """
    percent = c.get("resolution_percentage", 100) / 100
    winx, winy = (c.get(f"resolution_{a}", c.get(b)) for a, b in (("x", "width"), ("y", "height")))
    winx, winy = int(winx * percent), int(winy * percent)
    xasp, yasp = c.get("pixel_aspect_x", 1.0), c.get("pixel_aspect_y", 1.0)
    ycor, fit = yasp / xasp, c.get("sensor_fit", "AUTO")
    is_horizontal = xasp * winx >= yasp * winy if fit == "AUTO" else fit == "HORIZONTAL"
    viewfac = winx if is_horizontal else ycor * winy
    if "lens" in c:
        sensor = c["sensor_height"] if fit == "VERTICAL" else c["sensor_width"]
        pixsize = sensor / c["lens"] / viewfac
    else:
        pixsize = 2 * math.tan(c["angle_x"] / 2) / viewfac
    dx, dy = c.get("shift_x", 0.0) * viewfac, c.get("shift_y", 0.0) * viewfac
    xmin, xmax = (pixsize * (dx + sign * 0.5 * winx) for sign in (-1, 1))
    ymin, ymax = (pixsize * (dy + sign * 0.5 * ycor * winy) for sign in (-1, 1))
    x, y, z = (np.linalg.inv(matrix) @ np.c_[points, np.ones(len(points))].T)[:3]
    u = (x / -z - xmin) / (xmax - xmin) * winx
    v = (1 - (y / -z - ymin) / (ymax - ymin)) * winy
    return np.stack([u, v], axis=1)


def write(folder, data):
    path = folder / "cameras.json"
    path.write_text(json.dumps(data))
    return path


def listed():
    return [{**c, "matrix_world": pose(i).tolist()} for i, c in enumerate(CAMERAS)]


@pytest.mark.parametrize("form", ["list", "object", "mapping"])
def test_a_list(assert_projects, tmp_path, form):
    data = listed()
    data = {"object": {"cameras": data}, "mapping": {c["name"]: c for c in data}}.get(form, data)
    path = write(tmp_path, data)
    assert formats.sniff(path) == "blender"
    rig = formats.load(path)
    assert rig.names == tuple(c["name"] for c in CAMERAS)
    for index, (camera, c) in enumerate(zip(rig, CAMERAS, strict=True)):
        assert_projects(camera, lambda points, i=index, c=c: pixels(points, pose(i), c) - 0.5)


@pytest.mark.parametrize("mode", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "QUATERNION", None])
def test_poses_by_angles_and_quaternions(tmp_path, mode):
    from scipy.spatial.transform import Rotation

    angles = {"X": 0.3, "Y": -0.8, "Z": 2.1}
    order = "XYZ" if mode in ("QUATERNION", None) else mode
    matrix = np.eye(3)
    for axis in order:  # the first letter's turn comes first, about axes that stay
        matrix = (
            Rotation.from_rotvec(angles[axis] * np.eye(3)["XYZ".index(axis)]).as_matrix() @ matrix
        )
    q = np.roll(Rotation.from_matrix(matrix).as_quat(), 1)
    entry = {**WIDE, "location": [1, 2, 3], "rotation_euler": list(angles.values())}
    entry |= {"rotation_mode": mode, "rotation_quaternion": q.tolist()} if mode else {}
    camera = formats.load(write(tmp_path, [entry]))[0]
    np.testing.assert_allclose(camera.R, np.diag([1, -1, -1]) @ matrix.T, atol=1e-12)
    np.testing.assert_allclose(camera.position, [1, 2, 3], atol=1e-12)


#: Entries, and where Blender 4.5.15 (bpy) puts three points: ``Object.calc_matrix_camera``, in
#: single precision, with its corner of the image at (0, 0); the camera stands at (6, -4, 5).
BY_BLENDER = [
    ({"rotation_mode": "XYZ", "rotation_euler": [0.9375, 0.0, 1.0]},
     [[334.7972, 182.5607], [333.2745, 204.7062], [328.8018, 223.2202]]),
    ({"lens": 50.0, "shift_x": 0.03125, "shift_y": -0.0625,
      "rotation_mode": "XZY", "rotation_euler": [0.9375, 0.0, 1.0]},
     [[321.1388, 117.9438], [318.9636, 149.5803], [312.5739, 176.0288]]),
    ({"resolution_x": 480, "resolution_y": 640, "shift_y": 0.03125,
      "rotation_mode": "YXZ", "rotation_euler": [0.9375, 0.0, 1.0]},
     [[254.7972, 282.5607], [253.2745, 304.7062], [248.8018, 323.2202]]),
    ({"sensor_fit": "VERTICAL", "sensor_height": 24.0, "shift_x": 0.03125,
      "rotation_mode": "YZX", "rotation_euler": [1.1875, 0.875, 0.5]},
     [[306.3243, 184.6675], [305.0474, 209.5538], [300.3816, 230.4395]]),
    ({"pixel_aspect_y": 1.5, "shift_y": 0.0625,
      "rotation_mode": "ZXY", "rotation_euler": [0.5, 0.875, 1.1875]},
     [[307.7912, 243.7307], [306.8305, 260.2957], [302.4275, 274.2499]]),
    ({"resolution_x": 300, "sensor_fit": "HORIZONTAL", "shift_x": 0.0625, "shift_y": 0.0625,
      "rotation_mode": "ZYX", "rotation_euler": [0.6875, 0.75, 0.6875]},
     [[131.2617, 241.2482], [130.7715, 251.5992], [128.8621, 260.303]]),
    ({"resolution_x": 300, "pixel_aspect_x": 2.0, "shift_x": 0.0625,
      "rotation_mode": "QUATERNION", "rotation_quaternion": [0.781, 0.409, 0.219, 0.418]},
     [[133.9138, 202.1588], [133.3099, 222.8588], [131.3052, 240.2259]]),
]  # fmt: skip


def test_blender_itself_agrees(tmp_path):
    place = {"location": [6.0, -4.0, 5.0]}
    data = [{"name": f"c{i}", **WIDE, **place, **entry} for i, (entry, _) in enumerate(BY_BLENDER)]
    points = [(0.5, -0.25, 1.0), (-1.0, 0.75, -0.5), (0.0, 0.0, 0.0)]
    for camera, (_, found) in zip(formats.load(write(tmp_path, data)), BY_BLENDER, strict=True):
        np.testing.assert_allclose(camera.project(points)[0] + 0.5, found, rtol=0, atol=1e-4)


def test_values_for_all_and_names_from_images(tmp_path):
    entries = [
        {"filename": f"view_{i}.png", "matrix_world": pose(i).ravel().tolist()} for i in (0, 1)
    ]
    rig = formats.load(write(tmp_path, {**WIDE, "cameras": entries}))
    assert rig.names == ("view_0", "view_1")
    assert rig[0].image_size == (640, 480)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ((0, "lens"), None, "camera wide: lens: missing, expected lens and sensor_wi"),
        ((0, "sensor_width"), None, "camera wide: sensor_width: missing, expected lens"),
        ((3, "sensor_height"), None, "camera fitted: sensor_height: missing"),
        ((0, "resolution_y"), None, "camera wide: resolution_y: found nothing, expected"),
        ((0, "type"), "ORTHO", "camera wide: type: found 'ORTHO', expected PERSP"),
        ((0, "sensor_fit"), "WIDTH", "camera wide: sensor_fit: found 'WIDTH', expected AUTO"),
        ((0, "matrix_world"), None, "camera wide: matrix_world: missing"),
        ((0, "matrix_world"), np.diag([2, 2, 2, 1]).tolist(), "camera wide: matrix_world: not"),
        ((7, "angle_x"), 4.0, "camera by_angle: angle_x: found 4.0, expected radians between 0"),
        ((0, "lens"), -1, "camera wide: lens, sensor_width: found -1.0 and 36.0, exp"),
        ((0,), 3, "camera camera0: entry: found 3, expected a mapping"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(mutated, tmp_path, path, value, message):
    file = write(tmp_path, mutated(listed(), path, value))
    with pytest.raises(ValueError, match=re.escape(f"{file}: {message}")):
        blender.load(file)


def test_an_angle_that_has_two_meanings_is_refused(tmp_path):
    entry = {"camera_angle_x": 0.8, "w": 640, "h": 480, "matrix_world": pose(0).tolist()}
    K = formats.load(write(tmp_path, [entry]))[0].camera_matrix
    assert K[0, 0] == pytest.approx(320 / np.tan(0.4))
    with pytest.raises(ValueError, match="camera_angle_x: found it with an upright image"):
        formats.load(write(tmp_path, [{**entry, "w": 480, "h": 640}]))


def test_an_image_size_is_asked_for(tmp_path):
    entry = {"lens": 35.0, "sensor_width": 36.0, "matrix_world": pose(0).tolist()}
    path = write(tmp_path, [entry])
    with pytest.raises(ValueError, match=r"camera camera0: image_size: missing.*--image-size"):
        formats.load(path)
    assert formats.load(path, image_size=(640, 480))[0].image_size == (640, 480)


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=35)
def test_broken_files_are_refused_or_read(read_or_refused, damaged, tmp_path, data):
    file = tmp_path / "cameras.json"
    file.write_text(damaged(json.dumps(listed()[:2]), data))
    rig = read_or_refused(blender.load, file)
    assert rig is None or len(rig)
