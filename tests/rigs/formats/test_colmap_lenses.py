"""COLMAP's further camera models, and its binary files, against its own library.

Numbers of ``PYCOLMAP`` and ``BINARY`` were made by pycolmap 4.2.1.
"""

import base64
import struct

import numpy as np
import pytest

from rigs import Camera, RayTable, formats
from rigs.formats import _lens, colmap

MODELS = {
    "SIMPLE_RADIAL_FISHEYE": (800, 320.5, 240.25, 0.02),
    "RADIAL_FISHEYE": (800, 320.5, 240.25, 0.02, -0.01),
    "SIMPLE_FISHEYE": (800, 320.5, 240.25),
    "FISHEYE": (800, 810, 320.5, 240.25),
    "FOV": (400, 410, 320.5, 240.25, 0.9),
    "THIN_PRISM_FISHEYE": (
        *(800, 810, 320.5, 240.25, 0.02, -0.01, 1e-3, 2e-3, 3e-3, 0.0, 2e-3, -1e-3),
    ),
    "SIMPLE_DIVISION": (800, 320.5, 240.25, -0.1),
    "DIVISION": (800, 810, 320.5, 240.25, -0.1),
    "EUCM": (500, 510, 320.5, 240.25, 0.6, 1.1),
}
POINTS = np.array([[0.1, -0.2, 1.0], [-0.6, 0.3, 2.0], [0.35, 0.25, 1.0]])
#: ``Camera.img_from_cam(POINTS)`` of each model.
PYCOLMAP = dict(
    zip(
        MODELS,
        (
            [[399.281470, 82.687060], [88.452378, 356.273811], [585.800928, 429.750663]],
            [[399.279627, 82.690747], [88.477776, 356.261112], [585.728941, 429.699244]],
            [[399.205291, 82.839417], [88.937405, 356.031298], [584.928339, 429.127385]],
            [[399.205291, 80.871785], [88.937405, 357.478564], [584.928339, 431.488352]],
            [[362.788376, 153.558828], [195.929646, 304.092307], [462.932458, 344.530906]],
            [[399.434516, 80.721202], [89.013191, 357.609858], [586.734962, 432.413082]],
            [[400.103951, 81.042099], [83.140907, 358.929547], [595.503231, 436.680879]],
            [[400.103951, 79.052000], [83.140907, 360.413041], [595.503231, 439.136265]],
            [[369.699080, 139.883876], [175.718288, 314.088673], [485.871276, 360.734787]],
        ),
        strict=True,
    )
)
#: A model of two cameras in one rig, RADIAL_FISHEYE and OPENCV, by ``write_binary``.
BINARY = {
    "cameras": (
        "AgAAAAAAAAABAAAACQAAAIACAAAAAAAA4AEAAAAAAAAAAAAAAACJQAAAAAAACHRAAAAAAAAIbkB7FK5H"
        "4XqUP3sUrkfheoS/AgAAAAQAAAAgAwAAAAAAAFgCAAAAAAAAAAAAAAAgjEAAAAAAAHCMQAAAAAAACHlA"
        "AAAAAADEckCamZmZmZm5v5qZmZmZmak//Knx0k1iUD/8qfHSTWJgPw=="
    ),
    "images": (
        "AgAAAAAAAAABAAAAE5Iqo3387D+O7V86Xr3VPxOSKqN9/Ly/E5Iqo338zD8AAAAAAADwPwAAAAAAAADA"
        "AAAAAAAAPkABAAAAbGVmdC9hLnBuZwABAAAAAAAAAAAAAAAAAAxAAAAAAAAAEkD//////////wIAAAB3"
        "qA/6w5/sP+6CQMXvw9o/RK2OPZzKp7/G7APynlTDv1S/55Y49StAh/IaymsoKcBhpB0rEEY8QAIAAABy"
        "aWdodC9hLnBuZwABAAAAAAAAAAAAAAAAAAxAAAAAAAAAEkD//////////w=="
    ),
    "rigs": (
        "AQAAAAAAAAABAAAAAgAAAAAAAAABAAAAAAAAAAIAAAABrPU3TFWM7T+ZaNwK2kO6P5lo3AraQ8o/ck4l"
        "iOOy078AAAAAAAAUQAAAAAAAAPC/AAAAAAAAAEA="
    ),
}
WORLD = np.array([[1.0, 2, 3], [-4, 1, -2], [2, -3, 5]])
#: ``Image.project_point`` of the points of `WORLD`.
SEEN = {
    "left": [[338.113507, 184.980028], [237.722425, 201.817554], [415.333044, 80.142264]],
    "right": [[807.258615, -85.384162], [742.471243, 4.901280], [819.639467, -257.600454]],
}


def documented(model, points):
    """The pixels of points in the camera's axes, by the formulas of COLMAP's ``models.h``."""
    values = list(MODELS[model])
    first = 1 if model.startswith("SIMPLE") or model == "RADIAL_FISHEYE" else 2
    fx, fy = values[0], values[first - 1]
    cx, cy, *extra = values[first:]
    x, y, z = points.T
    u, v = x / z, y / z
    r = np.hypot(u, v)
    if "FISHEYE" in model:
        angle = np.arctan2(np.hypot(x, y), z)
        u, v = u * angle / r, v * angle / r
        q = u * u + v * v
        k1, k2, p1, p2, k3, k4, s1, s2 = (
            extra if "PRISM" in model else [*extra, 0, 0][:2] + [0] * 6
        )
        gain = 1 + q * (k1 + q * (k2 + q * (k3 + q * k4)))
        u, v = (
            u * gain + 2 * p1 * u * v + p2 * (q + 2 * u * u) + s1 * q,
            v * gain + 2 * p2 * u * v + p1 * (q + 2 * v * v) + s2 * q,
        )
    elif model == "FOV":
        gain = np.arctan(2 * r * np.tan(extra[0] / 2)) / (r * extra[0])
        u, v = u * gain, v * gain
    elif model == "EUCM":
        alpha, beta = extra
        depth = alpha * np.sqrt(beta * (x * x + y * y) + z * z) + (1 - alpha) * z
        u, v = x / depth, y / depth
    else:  # the radius of the image is undone by r_image / (1 + k r_image^2)
        gain = 2 / (1 + np.sqrt(1 - 4 * extra[0] * r * r))
        u, v = u * gain, v * gain
    return np.stack([fx * u + cx, fy * v + cy], axis=-1)


def write_text(folder, model, parameters=None):
    folder.mkdir(exist_ok=True)
    values = " ".join(map(repr, MODELS[model] if parameters is None else parameters))
    (folder / "cameras.txt").write_text(f"1 {model} 640 480 {values}\n")
    (folder / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    return folder


def write_binary(folder, **changed):
    folder.mkdir(exist_ok=True)
    for name, text in BINARY.items():
        content = changed.get(name, base64.b64decode(text))
        (folder / f"{name}.bin").write_bytes(content)
    return folder


@pytest.mark.parametrize("model", MODELS)
def test_models_project_by_colmaps_formula_and_as_pycolmap_does(tmp_path, model):
    camera = formats.load(write_text(tmp_path, model))["a"]
    assert isinstance(camera, Camera if model.endswith("FISHEYE") and "PRISM" not in model
                      else RayTable)  # fmt: skip
    uv = np.random.default_rng(0).integers([0, 0], camera.image_size, (200, 2)).astype(float)
    origins, directions = camera.rays(uv)
    points = origins + directions * np.linspace(1, 9, 200)[:, None]
    # COLMAP's centre of the top-left pixel is (0.5, 0.5)
    np.testing.assert_allclose(uv + 0.5, documented(model, points), rtol=0, atol=1e-6)
    np.testing.assert_allclose(documented(model, POINTS), PYCOLMAP[model], rtol=0, atol=2e-6)
    uv, _, valid = camera.project(POINTS)
    assert valid.all()
    near = 2e-6 if camera.has_lens_model else 1e-3  # between the rays of a table
    np.testing.assert_allclose(uv + 0.5, PYCOLMAP[model], rtol=0, atol=near)


def test_a_fisheye_that_says_it_has_a_prism_is_one(tmp_path):
    """Whose further terms are zero; the numbers are pycolmap's."""
    parameters = (800, 810, 320.5, 240.25, 0.02, -0.01, 3e-3, -1e-3, *[0] * 8)
    camera = formats.load(write_text(tmp_path, "RAD_TAN_THIN_PRISM_FISHEYE", parameters))["a"]
    expected = [[399.27965288, 80.721202917], [88.477006307, 357.711640557],
                [585.732308326, 432.069794414]]  # fmt: skip
    np.testing.assert_allclose(camera.project(POINTS)[0] + 0.5, expected, rtol=0, atol=1e-6)


def test_a_live_pycolmap_agrees(tmp_path):
    pycolmap = pytest.importorskip("pycolmap", reason="COLMAP's own library is not installed")
    for model, parameters in MODELS.items():
        camera = pycolmap.Camera(model=model, width=640, height=480, params=parameters)
        np.testing.assert_allclose(camera.img_from_cam(POINTS), PYCOLMAP[model], atol=1e-6)


def test_pycolmap_reads_what_is_written(make_rig, tmp_path):
    pycolmap = pytest.importorskip("pycolmap", reason="COLMAP's own library is not installed")
    rig = make_rig("none", "brown", "rational", "fisheye")
    formats.save(rig, tmp_path / "model", "colmap")
    model = pycolmap.Reconstruction(str(tmp_path / "model"))
    for image in model.images.values():
        camera = rig[image.name.removesuffix(".png")]
        origins, directions = camera.rays([[100.0, 200], [400, 300]])
        seen = [image.project_point(point) for point in origins + 300 * directions]
        np.testing.assert_allclose(seen, [[100.5, 200.5], [400.5, 300.5]], rtol=0, atol=1e-6)


def test_models_without_distortion_are_pinholes(tmp_path):
    for model in ("FOV", "DIVISION"):
        folder = write_text(tmp_path, model, (400, 410, 320, 240, 0.0))
        assert formats.load(folder)["a"].is_pinhole


@pytest.mark.parametrize(
    ("model", "parameters", "message"),
    [
        ("EQUIRECTANGULAR", (640, 480), "MODEL: found EQUIRECTANGULAR, expected one that a"),
        ("RAD_TAN_THIN_PRISM_FISHEYE", [800.0] * 16, "MODEL: found RAD_TAN_THIN_PRISM_FISHEYE, "),
        (
            "THIN_PRISM_FISHEYE",
            (800, 810, 320, 240, 0, 0, 1e-3, 0, 0, 0.2, 0, 0),
            "PARAMS: found k4 0.2 beside p1, p2, sx1 or sy1, expected 0: its term of the eighth",
        ),
        ("FOV", (400, 410, 320, 240, 3.2), "PARAMS: found omega 3.2, expected less than pi"),
    ],
)
def test_models_that_nothing_holds_are_refused_with_what_is_lost(
    refused_as, tmp_path, model, parameters, message
):
    folder = write_text(tmp_path, model, parameters)
    refused_as(f"{folder / 'cameras.txt'}: camera 1", message, folder)


def test_images_of_one_camera_with_two_tables_are_refused(tmp_path):
    write_text(tmp_path, "FOV")
    line = (tmp_path / "cameras.txt").read_text()
    (tmp_path / "cameras.txt").write_text(
        line + line.replace("1 FOV", "2 FOV").replace("0.9", "1")
    )
    pose = "1 0 0 0 0 0 0"
    (tmp_path / "images.txt").write_text(f"1 {pose} 1 left/a.png\n\n2 {pose} 2 left/b.png\n\n")
    with pytest.raises(ValueError, match="camera left: distortion: differs between images"):
        formats.load(tmp_path)


def test_a_binary_model_is_read_as_colmap_projects(tmp_path):
    folder = write_binary(tmp_path)
    assert formats.sniff(folder) == "colmap"
    for path in (folder, folder / "cameras.bin", folder / "images.bin"):
        rig = formats.load(path)
        assert rig.names == ("left", "right")
        assert [camera.image_size for camera in rig] == [(640, 480), (800, 600)]
        for name, expected in SEEN.items():
            uv, _, valid = rig[name].project(WORLD)
            assert valid.all()
            np.testing.assert_allclose(uv + 0.5, expected, rtol=0, atol=2e-6)
    (folder / "images.bin").unlink()  # then the sensors of rigs.bin are the cameras
    moved = rig.transformed(rig["left"].R, rig["left"].t)
    sensors = formats.load(folder)
    assert sensors.names == ("camera1", "camera2")
    np.testing.assert_allclose(sensors[1].t, moved[1].t, atol=1e-12)
    np.testing.assert_allclose(sensors[1].R, moved[1].R, atol=1e-12)


def test_a_project_is_read_through_its_sparse_folder(tmp_path):
    (tmp_path / "sparse").mkdir()
    write_binary(tmp_path / "sparse" / "0")
    assert formats.sniff(tmp_path) == "colmap"
    assert formats.load(tmp_path).names == ("left", "right")
    write_binary(tmp_path / "sparse" / "1")
    with pytest.raises(ValueError, match=r"found models in .*sparse/0 and .*sparse/1, expected"):
        formats.load(tmp_path)
    assert formats.load(tmp_path / "sparse" / "1").names == ("left", "right")


def test_images_of_many_points_are_read(tmp_path):
    write_text(tmp_path, "FISHEYE")
    points = " ".join(["100.25 200.75 -1"] * 600_000)
    images = [f"{number} 1 0 0 0 {number} 0 0 1 {number}.png\n{points}\n" for number in (1, 2)]
    (tmp_path / "images.txt").write_text("".join(images))
    assert (tmp_path / "images.txt").stat().st_size > 16 << 20  # most of other text files
    assert formats.load(tmp_path).names == ("1", "2")
    (tmp_path / "images.txt").write_text(images[0].replace("\n", f" {points} {points}\n", 1))
    with pytest.raises(ValueError, match="found a line 1 of more than 16 MiB"):
        formats.load(tmp_path)


def test_more_tables_than_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_lens, "MOST_RAYS", 640 * 480)
    write_text(tmp_path, "FOV")
    lines = [f"{number} 1 0 0 0 {number} 0 0 1 {number}.png\n\n" for number in range(1, 6)]
    (tmp_path / "images.txt").write_text("".join(lines[:4]))
    assert len(formats.load(tmp_path)) == 4
    (tmp_path / "images.txt").write_text("".join(lines))
    with pytest.raises(ValueError, match=r"found tables of rays with 1536000 pixels, expected"):
        formats.load(tmp_path)


def test_text_beside_binary_must_say_the_same(tmp_path):
    folder = write_binary(tmp_path)
    rig = formats.load(folder)
    cameras = {
        "left": "1 RADIAL_FISHEYE 640 480 800 320.5 240.25 0.02 -0.01\n",
        "right": "2 OPENCV 800 600 900 910 400.5 300.25 -0.1 0.05 0.001 0.002\n",
    }
    (folder / "cameras.txt").write_text("".join(cameras.values()))
    lines = [
        f"{number} {colmap.pose_text(rig[name].R, rig[name].t)} {number} {name}/a.png\n\n"
        for number, name in enumerate(cameras, 1)
    ]
    (folder / "images.txt").write_text("".join(reversed(lines)))
    assert formats.load(folder).names == ("right", "left")
    (folder / "cameras.txt").write_text("".join(cameras.values()).replace("-0.1 ", "-0.11 "))
    with pytest.raises(ValueError, match=r"found cameras.txt and cameras.bin of different models"):
        formats.load(folder)
    assert formats.load(folder / "cameras.bin").names == ("left", "right")


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("cameras", lambda b: b[:-1], "found the file's end at byte 159, expected another entry"),
        ("cameras", lambda b: b + b"x", "found more bytes after 2 entries, expected the file's"),
        ("cameras", lambda b: struct.pack("<Q", 2**63) + b[8:], "found the file's end at byte"),
        ("cameras", lambda b: b[:12] + b"\x63" + b[13:], "camera 1: MODEL: found 99"),
        ("images", lambda b: b.replace(b"left", b"le\nt"), "image 1: NAME: found 'le\\nt/a.png'"),
        ("images", lambda b: b.replace(b"left", b"le\xfft"), "image 1: NAME: found bytes that"),
        ("images", lambda b: b[:85] + b"\xff" * 8 + b[93:], "image 1: found the file's end befor"),
        ("images", lambda b: b[:-1], "image 2: found the file's end before its 1 points"),
    ],
)
def test_what_is_wrong_in_a_binary_model_is_named(refused_as, tmp_path, name, change, message):
    good = base64.b64decode(BINARY[name])
    folder = write_binary(tmp_path / "model", **{name: change(good)})
    refused_as(f"{folder / name}.bin", message, folder)
