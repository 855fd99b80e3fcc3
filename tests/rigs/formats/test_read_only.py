"""Formats that are only read: files written here by their documented formulas."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigs import Distortion, RayTable, formats
from rigs.formats import anipose, kalibr, middlebury, multical, myptv, openptv

MIDDLEBURY = "1\na.png 90 0 32 0 90 24 0 0 1 1 0 0 0 1 0 0 0 1 0.1 0.2 5\n"


def motion(camera):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = camera.R, camera.t
    return matrix


def multical_data(rig, master=None):
    models = {"none": "standard", "brown": "standard"}
    cameras = {
        camera.name: {
            "model": models.get(camera.distortion.model, camera.distortion.model),
            "image_size": list(camera.image_size),
            "K": camera.camera_matrix.tolist(),
            "dist": [list(camera.distortion.coefficients) or [0.0] * 5],
        }
        for camera in rig
    }
    poses = {
        c.name if master in (None, c.name) else f"{c.name}_to_{master}": {
            "R": c.R.tolist(),
            "T": c.t.tolist(),
        }
        for c in rig
    }
    return {"cameras": cameras, "camera_poses": poses, "image_sets": {"rgb": []}}


def kalibr_data(rig):
    lenses = {"none": "none", "brown": "radtan", "fisheye": "equidistant"}
    data = {}
    for index, camera in enumerate(rig):
        (fx, _, cx), (_, fy, cy) = camera.camera_matrix[:2].tolist()
        data[f"cam{index}"] = {
            "camera_model": "pinhole",
            "intrinsics": [fx, fy, cx, cy],
            "distortion_model": lenses[camera.distortion.model],
            "distortion_coeffs": list(camera.distortion.coefficients[:4]),
            "resolution": list(camera.image_size),
            "rostopic": f"/cam{index}/image_raw",
        }
        if index:
            link = motion(camera) @ np.linalg.inv(motion(rig[index - 1]))
            data[f"cam{index}"]["T_cn_cnm1"] = link.tolist()
    return data


def toml_of(rig, style):
    text = ""
    for index, camera in enumerate(rig):
        table = f"cam_{index}" if style == "anipose" else f"cameras.{index}"
        rotation = cv2.Rodrigues(np.array(camera.R))[0].ravel() if style == "anipose" else camera.R
        fields = {
            "size": camera.image_size,
            "matrix": camera.camera_matrix,
            "distortions": camera.distortion.coefficients or (0.0,) * 5,
            "rotation": rotation,
            "translation": camera.t,
        }
        lines = [f"{key} = {np.asarray(value).tolist()}" for key, value in fields.items()]
        name = f'name = "{camera.name}"' if style == "anipose" else f"cam_id = {index}"
        fisheye = str(camera.distortion.model == "fisheye").lower()
        text += "\n".join([f"[{table}]", name, *lines, f"fisheye = {fisheye}", ""]) + "\n"
    return text + "[metadata]\nadjusted = false\n"


@pytest.mark.parametrize("master", [None, "cam0"])
def test_multical(make_rig, assert_same_views, tmp_path, master):
    rig = make_rig("brown", "rational", "tilted")
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(multical_data(rig, master)))
    assert formats.sniff(path) == "multical"
    assert_same_views(formats.load(path), rig)


def test_kalibr(make_rig, assert_same_views, tmp_path):
    rig = make_rig("brown", "fisheye", "none")
    radtan = Distortion("brown", rig[0].distortion.coefficients[:4])
    rig = replace(rig, cameras=(replace(rig[0], distortion=radtan), *rig.cameras[1:]))
    path = tmp_path / "camchain.yaml"
    path.write_text(yaml.safe_dump(kalibr_data(rig)))
    assert formats.sniff(path) == "kalibr"
    found = formats.load(path)
    assert found.length_unit == "m"
    assert_same_views(found, rig.transformed(rig[0].R, rig[0].t))  # the world is cam0


def sphere_pixels(points, model, intrinsics, lens):
    """Pixels of points in camera axes, by the forward formulas of Kalibr's models."""
    x, y, z = points.T
    d = np.linalg.norm(points, axis=1)
    *parameters, fu, fv, pu, pv = intrinsics
    if model == "omni":
        (xi,) = parameters
        depth = z + xi * d
    elif model == "ds":
        xi, alpha = parameters
        z = xi * d + z
        depth = alpha * np.sqrt(x * x + y * y + z * z) + (1 - alpha) * z
    else:
        alpha, beta = parameters
        depth = alpha * np.sqrt(beta * (x * x + y * y) + z * z) + (1 - alpha) * z
    x, y = x / depth, y / depth
    k1, k2, p1, p2 = lens or (0, 0, 0, 0)
    q = x * x + y * y
    gain = 1 + k1 * q + k2 * q * q
    x, y = (
        x * gain + 2 * p1 * x * y + p2 * (q + 2 * x * x),
        y * gain + p1 * (q + 2 * y * y) + 2 * p2 * x * y,
    )
    return np.stack([fu * x + pu, fv * y + pv], axis=1)


@pytest.mark.parametrize(
    ("model", "intrinsics", "lens"),
    [
        ("omni", [0.8, 190.0, 191.0, 160.3, 119.2], [-0.1, 0.02, 1e-3, -5e-4]),
        ("omni", [1.2, 190.0, 191.0, 160.3, 119.2], []),
        ("ds", [-0.2, 0.59, 110.0, 111.0, 160.3, 119.2], []),
        ("eucm", [0.6, 1.1, 110.0, 111.0, 160.3, 119.2], []),
    ],
)
def test_kalibrs_wide_lenses_are_tables_of_rays(tmp_path, model, intrinsics, lens):
    data = {
        "cam0": {
            "camera_model": model,
            "intrinsics": intrinsics,
            "distortion_model": "radtan" if lens else "none",
            "distortion_coeffs": lens,
            "resolution": [320, 240],
        }
    }
    path = tmp_path / "camchain.yaml"
    path.write_text(yaml.safe_dump(data))
    camera = formats.load(path)["cam0"]
    assert isinstance(camera, RayTable)
    _, directions = camera.rays()
    uv = np.stack([a.ravel() for a in np.meshgrid(np.arange(320), np.arange(240))], axis=1)
    seen = np.flatnonzero(np.isfinite(directions[:, 0]))
    some = np.random.default_rng(0).choice(seen, 200)
    found = sphere_pixels(3 * directions[some], model, intrinsics, lens)
    np.testing.assert_allclose(found, uv[some], rtol=0, atol=1e-6)
    assert directions[seen, 2].min() < 0.5  # wide indeed


@pytest.mark.parametrize("style", ["anipose", "caliscope"])
def test_anipose_and_caliscope(make_rig, assert_same_views, tmp_path, style):
    rig = make_rig("brown", "fisheye", "none")
    path = tmp_path / "calibration.toml"
    path.write_text(toml_of(rig, style))
    assert formats.sniff(path) == "anipose"
    assert_same_views(formats.load(path), rig)


def write_openptv(folder, cameras, size=(1280, 1024), pitch=(0.012, 0.0125), indices=(1, 1, 1)):
    (folder / "parameters").mkdir(parents=True, exist_ok=True)
    (folder / "cal").mkdir(exist_ok=True)
    lines = [len(cameras)]
    for index, (exterior, interior, lens) in enumerate(cameras, 1):
        lines += [f"img/cam{index}.10002", f"cal/cam{index}.tif"]
        ori = [*exterior, *[0.0] * 9, *interior, 0.0, 0.0, 50.0]  # the matrix is a copy
        (folder / f"cal/cam{index}.tif.ori").write_text(" ".join(repr(float(v)) for v in ori))
        (folder / f"cal/cam{index}.tif.addpar").write_text(" ".join(map(repr, lens)))
    lines += [1, 0, 1, *size, *pitch, 0, *indices, 6]
    (folder / "parameters/ptv.par").write_text("\n".join(map(str, lines)) + "\n")
    return folder


def openptv_pixels(points, exterior, interior, lens, size, pitch):
    """Pixel coordinates by liboptv's imgcoord and trafo."""
    omega, phi, kappa = exterior[3:]
    co, so, cp, sp, ck, sk = (f(a) for a in (omega, phi, kappa) for f in (np.cos, np.sin))
    dm = np.array(
        [
            [cp * ck, -cp * sk, sp],
            [co * sk + so * sp * ck, co * ck - so * sp * sk, -so * cp],
            [so * sk - co * sp * ck, so * ck + co * sp * sk, co * cp],
        ]
    )
    d = (points - exterior[:3]) @ dm
    assert (d[:, 2] < 0).all()  # in front
    xh, yh, cc = interior
    x, y = xh - cc * d[:, 0] / d[:, 2], yh - cc * d[:, 1] / d[:, 2]
    k1, k2, k3, p1, p2, scx, she = lens
    q = x * x + y * y
    gain = k1 * q + k2 * q**2 + k3 * q**3
    x, y = (
        x + x * gain + p1 * (q + 2 * x * x) + 2 * p2 * x * y,
        y + y * gain + p2 * (q + 2 * y * y) + 2 * p1 * x * y,
    )
    x, y = scx * x - np.sin(she) * y, np.cos(she) * y
    return np.stack([x / pitch[0] + size[0] / 2, size[1] / 2 - y / pitch[1]], axis=-1)


OPENPTV = [
    (
        [120.0, 50.0, 600.0, -0.05, 0.2, 0.01],
        [0, 0, 60],
        [-4e-4, 1e-7, 0, 2e-5, -3e-5, 1.01, 2e-3],
    ),
    ([-90.0, 40.0, 500.0, -0.1, -0.2, 3.1], [0.3, -0.2, 55.0], [0, 0, 0, 0, 0, 1.0, 0.0]),
]


def test_openptv(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    assert formats.sniff(folder) == "openptv"
    rig = formats.load(folder)
    assert rig.names == ("cam1", "cam2")
    points = np.random.default_rng(0).uniform(-30, 30, (200, 3))
    for camera, values in zip(rig, OPENPTV, strict=True):
        expected = openptv_pixels(points, *values, (1280, 1024), (0.012, 0.0125))
        uv, _, valid = camera.project(points)
        assert valid.all()
        np.testing.assert_allclose(uv + 0.5, expected, atol=1e-6)  # its centres are at halves
    for path in ("parameters/ptv.par", "cal/cam1.tif.ori"):
        assert formats.load(folder / path)["cam1"] == rig["cam1"]


def test_openptv_projects_of_windows_have_backslashes(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    rig = formats.load(folder)
    parameters = folder / "parameters/ptv.par"
    parameters.write_text(parameters.read_text().replace("cal/", "cal\\"))
    assert formats.load(folder).cameras == rig.cameras
    parameters.write_text(parameters.read_text().replace("cal\\", "..\\cal\\"))
    with pytest.raises(ValueError, match="expected a path inside"):
        formats.load(folder)


def test_openptv_with_a_lens_round_another_centre_is_a_table_of_rays(tmp_path):
    values = (OPENPTV[0][0], [0.3, -0.2, 60.0], OPENPTV[0][2])
    size, pitch = (320, 256), (0.048, 0.05)
    camera = formats.load(write_openptv(tmp_path, [values], size, pitch))["cam1"]
    assert isinstance(camera, RayTable)
    uv = np.random.default_rng(0).integers([0, 0], size, (200, 2)).astype(float)
    origins, directions = camera.rays(uv)
    points = origins + directions * np.linspace(300, 900, 200)[:, None]
    expected = openptv_pixels(points, *values, size, pitch)
    np.testing.assert_allclose(uv + 0.5, expected, rtol=0, atol=1e-6)
    points = np.random.default_rng(0).uniform(-30, 30, (200, 3))
    uv, _, valid = camera.project(points)
    assert valid.all()
    np.testing.assert_allclose(uv + 0.5, openptv_pixels(points, *values, size, pitch), atol=1e-3)


@pytest.mark.parametrize(
    ("indices", "message"),
    [((1, 1.46, 1.33), r"n1, n2, n3: found refraction indices \[1.0, 1.46, 1.33\], expected 1")],
)
def test_openptv_with_glass_is_refused(tmp_path, indices, message):
    write_openptv(tmp_path, OPENPTV, indices=indices)
    with pytest.raises(ValueError, match=message) as error:
        formats.load(tmp_path)
    assert str(error.value).startswith(f"{tmp_path}/parameters/ptv.par: ")


MYPTV = {
    "name": "cam1",
    "O": [139.809, 36.919, 525.175],
    "theta": [-0.0638, -2.9031, 3.1372],
    "f": 6114.559,
    "xh, yh": [-259.27, -214.5],
    "E": np.zeros((3, 5)),
}


def myptv_text(values):
    rows = [values["O"], values["theta"], [values["f"]], values["xh, yh"], *values["E"]]
    return "\n".join([values["name"], *(" ".join(map(str, row)) + " " for row in rows)]) + "\n"


def myptv_ray(values, eta, zeta, size):
    """Direction of a pixel by imaging_mod.camera.get_r, turned to the front."""
    (sx, sy, sz), (cx, cy, cz) = np.sin(values["theta"]), np.cos(values["theta"])
    Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    xh, yh = values["xh, yh"]
    Z = np.stack([eta, zeta, eta**2, zeta**2, eta * zeta])
    ones = np.ones_like(eta)
    b = np.stack([eta - size[0] / 2 - xh, zeta - size[1] / 2 - yh, values["f"] * ones])
    r = (b + values["E"] @ Z).T @ (Rx @ Ry @ Rz) * np.sign(values["f"])
    return r / np.linalg.norm(r, axis=1, keepdims=True)


@pytest.mark.parametrize("focal", [6114.559, -6114.559])
def test_myptv(tmp_path, focal):
    values = MYPTV | {"f": focal}
    (tmp_path / "cam1").write_text(myptv_text(values))
    assert formats.sniff(tmp_path / "cam1") == "myptv"
    rig = formats.load(tmp_path, image_size=(1280, 1024))
    uv = np.random.default_rng(0).uniform(0, 1000, (200, 2))
    directions = myptv_ray(values, *uv.T, (1280, 1024))
    points = values["O"] + directions * np.linspace(300, 600, 200)[:, None]
    found, _, valid = rig["cam1"].project(points)
    assert valid.all()
    np.testing.assert_allclose(found, uv, atol=1e-6)
    with pytest.raises(ValueError, match="cam1: camera cam1: image_size: missing"):
        formats.load(tmp_path)


def newer(text, size="320 256"):
    """A file as myptv/TsaiModel/camera.py writes it."""
    name, rest = text.split("\n", 1)
    return f"Tsai model camera\n{name}\n{size} \n{rest}"


def test_myptvs_newer_files_hold_the_image_size(tmp_path):
    older, file = tmp_path / "older", tmp_path / "newer" / "cam1"
    file.parent.mkdir()
    older.write_text(myptv_text(MYPTV))
    file.write_text(newer(myptv_text(MYPTV)))
    assert formats.sniff(file) == formats.sniff(file.parent) == "myptv"
    rig = formats.load(file.parent)
    assert rig["cam1"].image_size == (320, 256)
    assert rig["cam1"] == formats.load(older, image_size=(320, 256))["cam1"]
    with pytest.raises(ValueError, match=r"image_size: found \(640, 480\), expected \(320, 256\)"):
        formats.load(file, image_size=(640, 480))
    for text, message in (
        (newer(myptv_text(MYPTV), "320"), "camera cam1: found 1 values, expected 2: width height"),
        (newer(myptv_text(MYPTV), "0 256"), "camera cam1: width: found 0.0"),
        ("Tsai model camera\n", "camera Tsai model camera: found 1 lines, expected 8"),
        ("extendedZolof \ncam1\nO 0 1.0\n", "model: found extendedZolof, expected Tsai model"),
    ):
        file.write_text(text)
        with pytest.raises(ValueError, match=re.escape(f"{file}: {message}")):
            formats.load(file, "myptv")


def test_myptv_with_a_correction_is_a_table_of_rays(tmp_path):
    E = np.array([[6e-3, -1e-2, -7e-6, 9e-7, 1.2e-5], [9e-3, -9e-3, -3e-6, 9e-6, -8e-6], [0] * 5])
    values = MYPTV | {"E": E, "xh, yh": [-59.0, -14.5], "f": 1600.0}
    (tmp_path / "cam1").write_text(myptv_text(values))
    camera = formats.load(tmp_path, image_size=(320, 256))["cam1"]
    assert isinstance(camera, RayTable)
    uv = np.random.default_rng(0).integers([0, 0], [320, 256], (200, 2)).astype(float)
    directions = myptv_ray(values, *uv.T, (320, 256))
    points = values["O"] + directions * np.linspace(300, 600, 200)[:, None]
    found, _, valid = camera.project(points)
    assert valid.all()
    np.testing.assert_allclose(found, uv, rtol=0, atol=1e-6)


def mutated(data, path, value):
    data = json.loads(json.dumps(data))
    inner = data
    for key in path[:-1]:
        inner = inner[key]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("cameras",), None, "cameras: missing"),
        (("camera_poses",), None, "camera_poses: missing"),
        (("camera_poses", "cam1"), None, "camera cam1: camera_poses: missing"),
        (("camera_poses", "cam1", "R"), None, "camera cam1: R: missing"),
        (
            ("cameras", "cam0", "model"),
            "omni",
            "camera cam0: model: found 'omni', expected one of",
        ),
        (("cameras", "cam0", "K"), [[1]], "camera cam0: K: found [[1]], expected 3 x 3"),
        (("cameras", "cam0", "dist"), [1, 2], "camera cam0: dist: found 2 coefficients"),
        (("cameras", "cam0", "image_size"), [0, 1], "camera cam0: image_size: found 0.0"),
        (("cameras", "cam0"), 3, "camera cam0: entry: found 3, expected a mapping"),
    ],
)
def test_what_is_wrong_in_multicals_files_is_named(make_rig, tmp_path, path, value, message):
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps(mutated(multical_data(make_rig("brown", "none")), path, value)))
    with pytest.raises(ValueError, match=re.escape(f"{file}: {message}")):
        multical.load(file)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            ("cam0", "camera_model"),
            "mei",
            "camera cam0: camera_model: found 'mei', expected one of pin",
        ),
        (("cam1", "distortion_model"), "fov", "camera cam1: distortion_model: found 'fov'"),
        (("cam1", "T_cn_cnm1"), None, "camera cam1: T_cn_cnm1: missing"),
        (
            ("cam1", "T_cn_cnm1"),
            np.ones((4, 4)).tolist(),
            "camera cam1: T_cn_cnm1: found last row",
        ),
        (
            ("cam0", "intrinsics"),
            [1, 2, 3],
            "camera cam0: intrinsics: found [1, 2, 3], expected 4",
        ),
        (("cam0", "distortion_coeffs"), [1], "camera cam0: distortion_coeffs: found [1]"),
        (("cam0",), None, "camera cam1: found no cam0 before it"),
        (("cam0", "resolution"), None, "camera cam0: resolution: missing"),
    ],
)
def test_what_is_wrong_in_kalibrs_files_is_named(make_rig, tmp_path, path, value, message):
    file = tmp_path / "camchain.yaml"
    file.write_text(yaml.safe_dump(mutated(kalibr_data(make_rig("fisheye", "none")), path, value)))
    with pytest.raises(ValueError, match=re.escape(f"{file}: {message}")):
        kalibr.load(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("translation = ", "moved = ", "camera cam0: translation: missing"),
        ("matrix = [[", "matrix = [[1], [", "camera cam0: matrix: found"),
        ("[cam_0]", "[cam_0", "broken TOML: "),
        ("fisheye = false", "fisheye = true", "camera cam0: distortions: found 5 coefficients"),
        ("cam_", "kamera_", "cameras: found none, expected tables"),
    ],
)
def test_what_is_wrong_in_toml_is_named(make_rig, tmp_path, old, new, message):
    file = tmp_path / "calibration.toml"
    file.write_text(toml_of(make_rig("brown", "none"), "anipose").replace(old, new))
    with pytest.raises(ValueError, match=re.escape(f"{file}: {message}")):
        anipose.load(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("6114.559", "0", "camera cam1: f: found 0"),
        ("6114.559", "nan", "camera cam1: f: found 'nan', expected a finite number"),
        ("139.809 ", "", "camera cam1: found 2 values, expected 3: O_x O_y O_z"),
        ("cam1\n", "", "camera 139.809 36.919 525.175: found 7 lines, expected 8"),
    ],
)
def test_what_is_wrong_in_myptvs_files_is_named(tmp_path, old, new, message):
    file = tmp_path / "cam1"
    file.write_text(myptv_text(MYPTV).replace(old, new))
    with pytest.raises(ValueError, match=re.escape(f"{file}: {message}")):
        myptv.load(file, (1280, 1024))


def test_what_is_wrong_in_openptvs_files_is_named(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    parameters, ori = folder / "parameters/ptv.par", folder / "cal/cam2.tif.ori"
    good = parameters.read_text()
    for old, new, message in (
        ("1280", "wide", "imx: found 'wide'"),
        ("0.012\n", "-1\n", "pix_x: found -1.0, expected a positive"),
        ("cal/cam1.tif", "../x/cam1.tif", "calibration image: found '../x/cam1.tif'"),
        ("2\n", "9\n", "found 17 lines, expected 31 for 9 cameras"),
    ):
        parameters.write_text(good.replace(old, new, 1))
        with pytest.raises(ValueError, match=re.escape(f"{parameters}: {message}")):
            formats.load(folder)
    parameters.write_text(good)
    ori.write_text("1 2 3")
    with pytest.raises(ValueError, match=re.escape(f"{ori}: found 3 values, expected 21: x0 y0")):
        formats.load(folder)
    ori.unlink()
    with pytest.raises(FileNotFoundError, match=r"cam2.tif.ori: no such file"):
        formats.load(folder)


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
def test_broken_files_are_refused_or_read(make_rig, read_or_refused, tmp_path, data):
    rig = make_rig("brown", "none", seed=1)
    name, text, load = data.draw(
        st.sampled_from(
            [
                ("a.json", json.dumps(multical_data(rig)), multical.load),
                ("a.yaml", yaml.safe_dump(kalibr_data(rig)), kalibr.load),
                ("a.toml", toml_of(rig, "anipose"), anipose.load),
                ("cam", myptv_text(MYPTV), lambda path: myptv.load(path, (64, 48))),
                ("cam1.tif.ori", "", openptv.load),
                ("a_par.txt", MIDDLEBURY, lambda path: middlebury.load(path, (64, 48))),
            ]
        )
    )
    folder = write_openptv(tmp_path, OPENPTV) if name.endswith("ori") else tmp_path
    file = folder / "cal" / name if name.endswith("ori") else tmp_path / name
    text = text or file.read_text()
    cut = data.draw(st.integers(0, len(text)))
    end = cut + data.draw(st.integers(0, 30))
    junk = data.draw(st.text('0179.-+eE[]{}:,"= \n\tx&*!#', max_size=10))
    file.write_text(text[:cut] + junk + text[end:])
    rig = read_or_refused(load, file)
    assert rig is None or len(rig)
