import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs import Camera, Distortion, Rig, formats
from rigs.formats import colmap

ALL = ("none", "brown", "rational", "fisheye")
#: A point (u, v) at depth one through each model, as COLMAP's documentation has them.
CAMERAS = {
    "SIMPLE_PINHOLE": ("f cx cy", {}),
    "PINHOLE": ("fx fy cx cy", {}),
    "SIMPLE_RADIAL": ("f cx cy k1", {"k1": -0.1}),
    "RADIAL": ("f cx cy k1 k2", {"k1": -0.1, "k2": 0.05}),
    "OPENCV": ("fx fy cx cy k1 k2 p1 p2", {"k1": -0.1, "k2": 0.05, "p1": 1e-3, "p2": 2e-3}),
    "FULL_OPENCV": (
        "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
        {"k1": -0.1, "p1": 1e-3, "p2": 2e-3, "k3": 0.01, "k4": 0.1, "k5": -0.05, "k6": 0.02},
    ),
    "OPENCV_FISHEYE": ("fx fy cx cy k1 k2 k3 k4", {"k1": 0.02, "k2": -0.01, "k3": 3e-3}),
}


def documented(model, values, u, v):
    """The pixel of the point (u, v, 1), by the formulas of COLMAP's camera models."""
    k = {f"k{i}": values.get(f"k{i}", 0) for i in range(1, 7)}
    p1, p2 = values.get("p1", 0), values.get("p2", 0)
    q = u * u + v * v
    if model == "OPENCV_FISHEYE":
        angle = np.arctan(np.sqrt(q))
        bent = angle * (
            1 + k["k1"] * angle**2 + k["k2"] * angle**4 + k["k3"] * angle**6 + k["k4"] * angle**8
        )
        x, y = u * bent / np.sqrt(q), v * bent / np.sqrt(q)
    else:
        gain = (1 + q * (k["k1"] + q * (k["k2"] + q * k["k3"]))) / (
            1 + q * (k["k4"] + q * (k["k5"] + q * k["k6"]))
        )
        x = u * gain + 2 * p1 * u * v + p2 * (q + 2 * u * u)
        y = v * gain + 2 * p2 * u * v + p1 * (q + 2 * v * v)
    fx, fy = values.get("fx", values.get("f")), values.get("fy", values.get("f"))
    return np.stack([fx * x + values["cx"], fy * y + values["cy"]], axis=-1)


def write_model(folder, cameras, images, rigs=None):
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text("# cameras\n" + "\n".join(cameras) + "\n")
    if images is not None:
        lines = [f"{line}\n10 20 -1 30.5 40 7" for line in images]
        (folder / "images.txt").write_text("# images\n" + "\n".join(lines) + "\n")
    if rigs is not None:
        (folder / "rigs.txt").write_text("# rigs\n" + "\n".join(rigs) + "\n")
    return folder


@pytest.mark.parametrize("model", CAMERAS)
def test_each_model_projects_by_colmaps_formula(tmp_path, model):
    names, lens = CAMERAS[model]
    values = {"f": 800, "fx": 800, "fy": 810, "cx": 320.5, "cy": 240.25, **lens}
    line = f"7 {model} 640 480 " + " ".join(repr(values.get(n, 0.0)) for n in names.split())
    turn = Rotation.from_euler("xyz", [0.3, -0.5, 1.2])
    x, y, z, w = turn.as_quat()
    pose = f"3 {w} {x} {y} {z} 1 -2 3 7 shots/a.png"
    rig = formats.load(write_model(tmp_path / "model", [line], [pose]))
    plane = np.random.default_rng(0).uniform(-0.35, 0.35, (200, 2))
    depth = np.random.default_rng(1).uniform(1, 9, (200, 1))
    in_camera = np.concatenate([plane, np.ones((200, 1))], axis=1) * depth
    points = (in_camera - [1, -2, 3]) @ turn.as_matrix()
    used = {n: values[n] for n in names.split() if n in values}
    uv, _, valid = rig["shots"].project(points)
    assert valid.all()
    # COLMAP's centre of the top-left pixel is (0.5, 0.5)
    np.testing.assert_allclose(uv + 0.5, documented(model, used, *plane.T), atol=1e-6)


def test_rigs_come_back(make_rig, assert_same_views, tmp_path):
    rig = make_rig(*ALL)
    formats.save(rig, tmp_path / "model", "colmap")
    assert formats.sniff(tmp_path / "model") == "colmap"
    assert formats.sniff(tmp_path / "model" / "images.txt") == "colmap"
    assert_same_views(formats.load(tmp_path / "model"), rig)
    (tmp_path / "model" / "images.txt").unlink()  # then the sensors of rigs.txt are the cameras
    names = ("camera1", "camera2", "camera3", "camera4")
    moved = rig.transformed(rig[0].R, rig[0].t)
    assert_same_views(formats.load(tmp_path / "model"), moved, names)


@pytest.mark.parametrize("written", range(4))
def test_half_a_model_over_another_is_not_read(make_rig, tmp_path, monkeypatch, written):
    colmap.save(make_rig("none"), tmp_path)
    assert len(formats.load(tmp_path, "colmap")) > 0
    files, write_text = [], colmap.write_text

    def stopped(path, text):
        if len(files) == written:
            raise KeyboardInterrupt
        files.append(path)
        write_text(path, text)

    monkeypatch.setattr(colmap, "write_text", stopped)
    with pytest.raises(KeyboardInterrupt):
        colmap.save(make_rig("brown"), tmp_path)
    with pytest.raises(FileNotFoundError, match=r"cameras\.txt"):
        formats.load(tmp_path, "colmap")


def test_a_moving_rig_is_read_from_rigs_txt(tmp_path):
    cameras = ["1 PINHOLE 640 480 800 800 320 240", "2 PINHOLE 640 480 700 700 320 240"]
    images = [
        "1 1 0 0 0 0 0 0 1 left/a.png",
        "2 1 0 0 0 -5 0 0 2 right/a.png",
        "3 1 0 0 0 0 0 9 1 left/b.png",
        "4 1 0 0 0 -5 0 9 2 right/b.png",
    ]
    folder = write_model(tmp_path / "model", cameras, images)
    with pytest.raises(ValueError, match=r"camera left: t: differs between left/a.png"):
        formats.load(folder)
    write_model(folder, cameras, images, ["1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -5 0 0"])
    rig = formats.load(folder)
    assert rig.names == ("left", "right")
    assert rig["right"].position.tolist() == [5, 0, 0]
    assert rig.world_frame == "the reference sensor's axes"


#: One camera that moved, its images in two folders.
MOVED = [
    "1 1 0 0 0 0 0 0 1 low/a.png",
    "2 1 0 0 0 0 0 9 1 low/b.png",
    "3 1 0 0 0 5 0 0 1 high/a.png",
    "4 1 0 0 0 5 0 9 1 high/c.png",
]


@pytest.mark.parametrize("rigs", [(), ("1 1 CAMERA 1",)])
def test_images_of_one_camera_that_moved_are_cameras(tmp_path, rigs):
    """Since 3.12 COLMAP calls a camera by itself a rig of one sensor."""
    cameras = ["1 PINHOLE 640 480 800 800 320 240"]
    rig = formats.load(write_model(tmp_path / "model", cameras, MOVED, rigs))
    assert rig.names == ("low_a", "b", "high_a", "c")
    assert [camera.t.tolist() for camera in rig] == [[0, 0, 0], [0, 0, 9], [5, 0, 0], [5, 0, 9]]


def test_several_cameras_that_moved(tmp_path):
    cameras = ["1 PINHOLE 640 480 800 800 320 240", "2 PINHOLE 640 480 700 700 320 240"]
    images = [line.replace(" 1 high", " 2 high") for line in MOVED]
    folder = write_model(tmp_path / "model", cameras, images)
    message = r"camera low: t: differs between low/a.png and low/b.png, .*: where cameras "
    with pytest.raises(ValueError, match=f"{message}moved round a still scene, put their images"):
        formats.load(folder)
    write_model(folder, cameras, images, ["1 1 CAMERA 1", "2 1 CAMERA 2"])  # two rigs of one
    assert formats.load(folder).names == ("low_a", "b", "high_a", "c")


def test_skew_is_refused_and_a_lens_is_written_shorter(tmp_path, make_rig, assert_same_views):
    with pytest.raises(ValueError, match=r"camera cam0: camera_matrix: found skew 1.0"):
        formats.save(make_rig("none", skew=1.0), tmp_path / "model", "colmap")
    long = Distortion("tilted", (-0.1, 0.02, 1e-3, 2e-3, *[0.0] * 10))
    camera = Camera("a", (640, 480), [[900, 0, 300], [0, 900, 250], [0, 0, 1]], long, t=[0, 0, 9])
    formats.save(Rig((camera,)), tmp_path / "model", "colmap")
    assert " OPENCV " in (tmp_path / "model" / "cameras.txt").read_text()
    assert_same_views(formats.load(tmp_path / "model"), Rig((camera,)))


CAMERA, IMAGE = "1 PINHOLE 640 480 800 800 320 240", "1 1 0 0 0 0 0 5 1 a.png"


@pytest.mark.parametrize(
    ("file", "cameras", "images", "message"),
    [
        ("cameras", CAMERA.replace("PINHOLE", "LENS"), IMAGE, "camera 1: MODEL: found 'LENS'"),
        ("cameras", CAMERA + " 3", IMAGE, "camera 1: found 5 values, expected 4: fx fy cx cy"),
        ("cameras", CAMERA.replace("640", "x"), IMAGE, "camera 1: WIDTH: found 'x'"),
        ("cameras", CAMERA.replace("800", "-1", 1), IMAGE, "camera 1: camera_matrix: found focal"),
        ("cameras", f"{CAMERA}\n{CAMERA}", IMAGE, "camera 1: CAMERA_ID: found twice"),
        ("images", CAMERA, IMAGE.replace(" 1 a", " 2 a"), "image a.png: CAMERA_ID: found 2"),
        ("images", CAMERA, IMAGE.replace("1 1 0", "1 0 0"), "image a.png: QW, QX, QY, QZ: found"),
        ("images", CAMERA, "1 1 0 0", "found '1 1 0 0', expected IMAGE_ID QW QX"),
        ("images", CAMERA, "", "found no images"),
    ],
)
def test_what_is_wrong_is_named(refused_as, tmp_path, file, cameras, images, message):
    folder = write_model(tmp_path / "model", [cameras], [images])
    if not images:
        (folder / "images.txt").write_text("")
    refused_as(f"{folder / file}.txt", message, folder, "colmap")


def test_images_without_lines_of_points_are_not_lost(tmp_path):
    folder = write_model(tmp_path / "model", [CAMERA], [])
    images = [IMAGE.replace("5 1 a.png", f"{i + 5} 1 {'abcd'[i]}.png") for i in range(4)]
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    with pytest.raises(ValueError, match=r"images.txt: found .*b.png.*, expected POINTS2D"):
        formats.load(folder)
    (folder / "images.txt").write_text("\n\n".join(images))
    assert formats.load(folder).names == ("a", "b", "c", "d")
