"""COLMAP's text models: a folder of ``cameras.txt``, ``images.txt`` and, since 3.12, ``rigs.txt``.

Poses are world to camera in OpenCV's axes, ``x_cam = R(QW, QX, QY, QZ) @ x_world + T``; (0.5, 0.5)
is the centre of the top-left pixel; lengths have no unit. Known lens models: SIMPLE_PINHOLE,
PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE.

An image's camera is its folder, else the image itself, as in ``transforms.json``. A folder whose
images stand in different places belongs to a moving rig: then ``rigs.txt`` is read, and the world
is the axes of the rig's reference sensor. Without ``images.txt`` too; sensors are then named by
their numbers. Written are the cameras as sensors of one rig, seen in one frame, one image
``<camera>.png`` each. https://colmap.github.io/format.html, https://colmap.github.io/cameras.html
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import numpy as np

from rigs.camera import Camera
from rigs.files.text import read_text, shortened, write_text
from rigs.files.units import UNKNOWN
from rigs.formats._colmap_rigs import read_sensors, rig_texts
from rigs.formats._lens import named_model, refuse_skew, refuse_tables
from rigs.formats._values import as_count, errors_of, errors_of_file, numbers_of_line
from rigs.formats._views import difference, grouped, named
from rigs.geometry.rotation import matrix_of_quaternion, quaternion_of_matrix
from rigs.lens import Distortion
from rigs.rig import Rig

#: The model here of each of COLMAP's, and its parameters in the order of the file.
_MODELS: dict[str, tuple[str, str]] = {
    "SIMPLE_PINHOLE": ("none", "f cx cy"),
    "PINHOLE": ("none", "fx fy cx cy"),
    "SIMPLE_RADIAL": ("brown", "f cx cy k1"),
    "RADIAL": ("brown", "f cx cy k1 k2"),
    "OPENCV": ("brown", "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": ("rational", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": ("fisheye", "fx fy cx cy k1 k2 k3 k4"),
}
_SLOTS = {
    "brown": ("k1", "k2", "p1", "p2"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
_POSE = ["QW", "QX", "QY", "QZ", "TX", "TY", "TZ"]
_FIELDS = {
    "image_size": "WIDTH, HEIGHT",
    "distortion": "PARAMS",
    "camera_matrix": "PARAMS",
    "R": "QW, QX, QY, QZ",
    "t": "TX, TY, TZ",
}
_FILES = ("cameras.txt", "images.txt", "rigs.txt", "frames.txt")


def looks_like(path: Path, head: str) -> bool:
    """Return whether a folder, or the folder of a file, is a text model."""
    if path.is_file() and path.name not in _FILES:
        return False
    folder = _folder(path)
    if path.is_dir() and (folder / "cameras.bin").is_file():
        return True  # load() explains that it is binary
    return (folder / "cameras.txt").is_file() and any(
        (folder / name).is_file() for name in ("images.txt", "rigs.txt")
    )


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a model's folder, or of one of its files.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    folder = _folder(Path(path))
    if (folder / "cameras.bin").is_file() and not (folder / "cameras.txt").is_file():
        raise ValueError(
            f"{folder}: found a binary model, expected text: colmap model_converter "
            "--output_type TXT makes it"
        )
    sensors = _read_cameras(folder / "cameras.txt")
    if not (folder / "images.txt").is_file():
        return _rig_of_sensors(folder, sensors, {})
    file = folder / "images.txt"
    with errors_of_file(file):
        views = _read_images(read_text(file), sensors)
        if not views:
            raise ValueError("found no images, expected at least one")
        images = [image for image, _, _ in views]
        cameras = [camera for _, camera, _ in views]
        names, frames = named(images, cameras, [None] * len(images), folder.name or "frame")
        if (folder / "rigs.txt").is_file() and _is_moving(names, cameras):
            return _rig_of_sensors(
                folder, sensors, {s: n for (_, _, s), n in zip(views, names, strict=True)}
            )
        found, _ = grouped(folder, images, cameras, names, frames, _FIELDS)
        return Rig(tuple(found), UNKNOWN, "as in COLMAP's model")


def save(rig: Rig, path: Path) -> None:
    """Write a model into a folder: cameras, images, rigs, frames and no points.

    Raises
    ------
    ValueError
        Naming a camera whose lens or skew COLMAP lacks.
    """
    refuse_tables(rig, "COLMAP")
    folder = path.parent if path.name in _FILES else path
    lines = [_camera_line(index, camera) for index, camera in enumerate(rig, 1)]
    images = [
        f"{index} {pose_text(camera.R, camera.t)} {index} {camera.name}.png\n"
        for index, camera in enumerate(rig, 1)
    ]
    texts = {
        "cameras.txt": "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n" + "\n".join(lines) + "\n",
        "images.txt": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
        "# POINTS2D[] as (X, Y, POINT3D_ID)\n" + "\n".join(images) + "\n",
        **rig_texts(rig, pose_text),
        "points3D.txt": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n",
    }
    for camera in rig:
        if any(c.isspace() for c in camera.name):
            raise ValueError(
                f"camera {camera.name}: name: found a space, which COLMAP's files cannot hold"
            )
    folder.mkdir(parents=True, exist_ok=True)
    # Files of two models would be read as one. Without cameras.txt none is read until all exist.
    (folder / "cameras.txt").unlink(missing_ok=True)
    for name in sorted(texts, key="cameras.txt".__eq__):
        write_text(folder / name, texts[name])


def pose_text(R: np.ndarray, t: np.ndarray) -> str:
    """Return the seven numbers of a pose."""
    return " ".join(repr(float(v)) for v in (*quaternion_of_matrix(R), *t))


def _folder(path: Path) -> Path:
    """Return the folder of a model, given it or one of its files."""
    return path.parent if path.is_file() else path


def _lines(text: str) -> list[str]:
    """Return the lines that are no comments; empty ones stay."""
    return [line for line in text.splitlines() if not line.lstrip().startswith("#")]


def _read_cameras(file: Path) -> dict[int, Camera]:
    """Return the cameras of ``cameras.txt`` by number, without their poses."""
    sensors = {}
    with errors_of_file(file):
        for line in _lines(read_text(file)):
            if not line.strip():
                continue
            number, *words = line.split()
            with errors_of(f"camera {number}"):
                key = as_count(number, "CAMERA_ID")
                if key in sensors:
                    raise ValueError("CAMERA_ID: found twice, expected once")
                if len(words) < 3:
                    raise ValueError(
                        f"found {shortened(line)}, expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS"
                    )
            sensors[key] = _sensor(number, words)
    return sensors


def _sensor(number: str, words: list[str]) -> Camera:
    """Return the camera of a line of ``cameras.txt``."""
    with errors_of(f"camera {number}"):
        if words[0] not in _MODELS:
            raise ValueError(
                f"MODEL: found {shortened(words[0])}, expected one of {', '.join(_MODELS)}"
            )
        model, parameters = _MODELS[words[0]]
        values = dict(
            zip(parameters.split(), numbers_of_line(words[3:], parameters.split()), strict=True)
        )
        size = as_count(words[1], "WIDTH"), as_count(words[2], "HEIGHT")
        lens = [values.get(name, 0.0) for name in _SLOTS.get(model, ())]
        fx, fy = (values.get(key, values.get("f")) for key in ("fx", "fy"))
        K = [[fx, 0.0, values["cx"] - 0.5], [0.0, fy, values["cy"] - 0.5], [0.0, 0.0, 1.0]]
        distortion = Distortion(model, tuple(lens))
    return Camera(number, size, K, distortion, status="calibrated")


def _read_images(text: str, sensors: dict[int, Camera]) -> list[tuple[PurePosixPath, Camera, int]]:
    """Return the images' names, their posed cameras, and the cameras' numbers."""
    views = []
    lines = _lines(text)
    while lines and not lines[0].strip():
        lines.pop(0)
    for line in lines[1::2]:  # every second one, often empty
        if len(line.split()) % 3:
            raise ValueError(f"found {shortened(line)}, expected POINTS2D after each image")
    for line in lines[::2]:
        if not line.strip():
            continue
        words = line.split(maxsplit=9)
        if len(words) != 10:
            raise ValueError(
                f"found {shortened(line)}, expected IMAGE_ID {' '.join(_POSE)} CAMERA_ID NAME"
            )
        image = PurePosixPath(words[9].strip().replace("\\", "/"))
        with errors_of(f"image {words[9].strip()}"):
            pose = numbers_of_line(words[1:8], _POSE)
            number = as_count(words[8], "CAMERA_ID")
            if number not in sensors:
                raise ValueError(f"CAMERA_ID: found {number}, expected one of cameras.txt")
            R = matrix_of_quaternion(pose[:4], "QW, QX, QY, QZ")
            camera = _posed(sensors[number], str(number), R, np.array(pose[4:]))
        views.append((image, camera, number))
    return views


def _posed(camera: Camera, name: str, R: np.ndarray, t: np.ndarray) -> Camera:
    """Return a camera under another name at another pose."""
    return Camera(
        name,
        camera.image_size,
        camera.camera_matrix,
        camera.distortion,
        R,
        t,
        status="calibrated",
    )


def _is_moving(names: list[str], cameras: list[Camera]) -> bool:
    """Return whether images of one camera were taken from different places."""
    first = dict(zip(reversed(names), reversed(cameras), strict=True))
    return any(
        difference(camera, first[name]) in ("R", "t")
        for name, camera in zip(names, cameras, strict=True)
    )


def _rig_of_sensors(folder: Path, sensors: dict[int, Camera], names: dict[int, str]) -> Rig:
    """Return the rig of ``rigs.txt``, its cameras named by their images' folders."""
    file = folder / "rigs.txt"
    with errors_of_file(file):
        cameras = []
        for number, (R, t) in read_sensors(_lines(read_text(file))).items():
            if number not in sensors:
                raise ValueError(f"SENSOR_ID: found {number}, expected one of cameras.txt")
            name = names.get(number, f"camera{number}")
            cameras.append(_posed(sensors[number], name, R, t))
        return Rig(tuple(cameras), UNKNOWN, "the reference sensor's axes")


def _camera_line(number: int, camera: Camera) -> str:
    """Return a camera's line of ``cameras.txt``."""
    refuse_skew(camera, "COLMAP")
    model, coefficients = named_model(camera, "COLMAP")
    if model == "OPENCV" and coefficients["k3"]:
        model = "FULL_OPENCV"
    (fx, _, cx), (_, fy, cy) = camera.camera_matrix[:2].tolist()
    values = {"fx": fx, "fy": fy, "cx": cx + 0.5, "cy": cy + 0.5, **coefficients}
    parameters = (repr(values.get(name, 0.0)) for name in _MODELS[model][1].split())
    width, height = camera.image_size
    return f"{number} {model} {width} {height} {' '.join(parameters)}"
