"""MyPTV's cameras, written here by its formulas."""

import re

import numpy as np
import pytest

from rigs import RayTable, formats

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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("6114.559", "0", "camera cam1: f: found 0"),
        ("6114.559", "nan", "camera cam1: f: found 'nan', expected a finite number"),
        ("139.809 ", "", "camera cam1: found 2 values, expected 3: O_x O_y O_z"),
        ("cam1\n", "", "camera 139.809 36.919 525.175: found 7 lines, expected 8"),
    ],
)
def test_what_is_wrong_in_myptvs_files_is_named(refused_as, tmp_path, old, new, message):
    file = tmp_path / "cam1"
    file.write_text(myptv_text(MYPTV).replace(old, new))
    refused_as(file, message, file, "myptv", image_size=(1280, 1024))
