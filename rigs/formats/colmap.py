"""COLMAP's models: a folder of ``cameras``, ``images`` and, since 3.12, ``rigs``, as .txt or .bin.

Poses are world to camera in OpenCV's axes, ``x_cam = R(QW, QX, QY, QZ) @ x_world + T``; (0.5, 0.5)
is the centre of the top-left pixel; lengths have no unit.

A folder whose images stand in different places belongs to a moving rig: then ``rigs`` is read, and
the world is the axes of the rig's reference sensor. Without ``images`` too; sensors are then named
by their numbers. Where no rig has several sensors, or one camera took all images, cameras moved
round a still scene, and every image is a camera. Written are the cameras as sensors of one rig, as
text, seen in one frame, one image ``<camera>.png`` each.
https://colmap.github.io/format.html, https://colmap.github.io/cameras.html
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import dropwhile
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike, LensCamera, has_lens
from rigs.files.text import iter_lines, shortened, write_text
from rigs.files.units import UNKNOWN
from rigs.formats._colmap_files import POSE, has_several_sensors, read_sensors, rig_texts, text_of
from rigs.formats._colmap_lenses import MODELS, Sensor, read_sensor
from rigs.formats._lens import limited, named_model, refuse_skew, refuse_tables
from rigs.formats._values import as_count, errors_of, errors_of_file, numbers_of_line
from rigs.formats._views import difference, finished, named
from rigs.geometry.rotation import matrix_of_quaternion, quaternion_of_matrix
from rigs.rig import Rig

_STEMS, _ENDINGS = ("cameras", "images", "rigs", "frames"), (".txt", ".bin")
_FILES = tuple(f"{stem}{ending}" for stem in _STEMS for ending in _ENDINGS)


def looks_like(path: Path, head: str) -> bool:
    """Return whether a folder, or the folder of a file, is a model."""
    if path.is_file() and path.name not in _FILES:
        return False
    return any(_endings(path, folder) for folder in _folders(path))


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a model's folder, or of one of its files."""
    folder, *others = _folders(path)
    if others:
        raise ValueError(f"{path}: found models in {folder} and {others[0]}, expected one as IN")
    rigs = [_load(folder, ending) for ending in _endings(path, folder) or [".txt"]]
    if len(rigs) > 1 and not _same(*rigs):
        raise ValueError(
            f"{folder}: found cameras.txt and cameras.bin of different models, expected one of "
            "them as IN"
        )
    return rigs[0]


def _load(folder: Path, ending: str) -> Rig:
    """Return the rig of a folder's text files, or of its binary ones."""
    sensors = _read_cameras(folder / f"cameras{ending}")
    file, rigs = folder / f"images{ending}", folder / f"rigs{ending}"
    if not file.is_file():
        return _rig_of_sensors(rigs, sensors, {})
    with errors_of_file(file):
        views = _read_images(_lines(file), sensors)
        if not views:
            raise ValueError("found no images, expected at least one")
        images, cameras, numbers = zip(*views, strict=True)
        is_rig = rigs.is_file() and has_several_sensors(_lines(rigs))
        # since 3.12 a camera by itself is a rig of one: rigs of one sensor are no moving rig
        taken_by = None if is_rig else [0] * len(images) if rigs.is_file() else numbers
        stem = folder.name or "frame"
        names, frames = named(images, cameras, [None] * len(images), stem, taken_by)
        if is_rig and _is_moving(names, cameras):
            return _rig_of_sensors(rigs, sensors, dict(zip(numbers, names, strict=True)))
        finish = [sensors[number].finish for number in numbers]
        found = finished(images, cameras, names, frames, finish)
        return Rig(found, UNKNOWN, "as in COLMAP's model")


def save(rig: Rig, path: Path) -> None:
    """Write a model into a folder: cameras, images, rigs, frames and no points."""
    if not len(rig):
        raise ValueError("cameras: found none, expected at least one")
    cameras = refuse_tables(rig, "COLMAP")
    folder = path.parent if path.name in _FILES else path
    lines = [_camera_line(index, camera) for index, camera in enumerate(cameras, 1)]
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
            raise ValueError(f"camera {camera.name}: name: found a space, which COLMAP lacks")
    folder.mkdir(parents=True, exist_ok=True)
    # Files of two models would be read as one. Without cameras.txt none is read until all exist.
    (folder / "cameras.txt").unlink(missing_ok=True)
    for name in sorted(texts, key="cameras.txt".__eq__):
        write_text(folder / name, texts[name])


def pose_text(R: np.ndarray, t: np.ndarray) -> str:
    """Return the seven numbers of a pose."""
    return " ".join(repr(float(v)) for v in (*quaternion_of_matrix(R), *t))


def _folders(path: Path) -> list[Path]:
    """Return the folders with a model: a path's own, else those in its ``sparse``."""
    if path.is_file():
        return [path.parent]
    sparse = path / "sparse"
    inner = sorted(sparse.iterdir()) if sparse.is_dir() else []
    for folders in ([path], [sparse], inner):
        if found := [folder for folder in folders if _endings(folder, folder)]:
            return found
    return [path]


def _endings(path: Path, folder: Path) -> list[str]:
    """Return the endings of the models in a folder, or the one of a file of a model."""
    found = [
        ending
        for ending in _ENDINGS
        if (folder / f"cameras{ending}").is_file()
        and any((folder / f"{stem}{ending}").is_file() for stem in ("images", "rigs"))
    ]
    return [ending for ending in found if not path.is_file() or path.suffix == ending]


def _same(rig: Rig, other: Rig) -> bool:
    """Return whether two rigs have the same cameras, in any order."""
    return set(rig.names) == set(other.names) and all(
        camera == twin or (has_lens(camera) and has_lens(twin) and not difference(camera, twin))
        for camera, twin in ((camera, other[camera.name]) for camera in rig)
    )


def _lines(file: Path) -> Iterator[str]:
    """Yield the lines of a model's file, or of its text form, that are no comments."""
    is_text = file.suffix != ".bin"
    lines = iter_lines(file, keep_empty=True) if is_text else text_of(file).splitlines()
    return (line for line in lines if not line.startswith("#"))


def _read_cameras(file: Path) -> dict[int, Sensor]:
    """Return the cameras of ``cameras.txt`` by number."""
    sensors = {}
    with errors_of_file(file):
        for line in _lines(file):
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
            sensors[key] = read_sensor(number, words)
    return sensors


def _read_images(
    lines: Iterator[str], sensors: dict[int, Sensor]
) -> list[tuple[PurePosixPath, Camera, int]]:
    """Return the images' names, their posed cameras, and the cameras' numbers."""
    views = []
    for index, line in enumerate(dropwhile(lambda line: not line, lines)):
        if index % 2:  # every second one, often empty
            if len(line.split()) % 3:
                raise ValueError(f"found {shortened(line)}, expected POINTS2D after each image")
            continue
        if not line:
            continue
        words = line.split(maxsplit=9)
        if len(words) != 10:
            raise ValueError(
                f"found {shortened(line)}, expected IMAGE_ID {' '.join(POSE)} CAMERA_ID NAME"
            )
        image = PurePosixPath(words[9].strip().replace("\\", "/"))
        with errors_of(f"image {words[9].strip()}"):
            pose = numbers_of_line(words[1:8], POSE)
            number = as_count(words[8], "CAMERA_ID")
            if number not in sensors:
                raise ValueError(f"CAMERA_ID: found {number}, expected one of cameras.txt")
            R = matrix_of_quaternion(pose[:4], "QW, QX, QY, QZ")
            camera = replace(sensors[number].camera, R=R, t=np.array(pose[4:]))
        views.append((image, camera, number))
    return views


def _is_moving(names: Sequence[str], cameras: Sequence[Camera]) -> bool:
    """Return whether images of one camera were taken from different places."""
    first = dict(zip(reversed(names), reversed(cameras), strict=True))
    return any(
        difference(camera, first[name]) in ("R", "t")
        for name, camera in zip(names, cameras, strict=True)
    )


def _rig_of_sensors(file: Path, sensors: dict[int, Sensor], names: dict[int, str]) -> Rig:
    """Return the rig of ``rigs.txt``, its cameras named by their images' folders."""

    def camera(number: int, R: NDArray, t: NDArray) -> CameraLike:
        if number not in sensors:
            raise ValueError(f"SENSOR_ID: found {number}, expected one of cameras.txt")
        name = names.get(number, f"camera{number}")
        return sensors[number].finish(replace(sensors[number].camera, name=name, R=R, t=t))

    with errors_of_file(file):
        poses = read_sensors(list(_lines(file)))
        cameras = limited(camera(number, R, t) for number, (R, t) in poses.items())
        return Rig(cameras, UNKNOWN, "the reference sensor's axes")


def _camera_line(number: int, camera: LensCamera) -> str:
    """Return a camera's line of ``cameras.txt``."""
    refuse_skew(camera, "COLMAP")
    model, coefficients = named_model(camera, "COLMAP")
    if model == "OPENCV" and coefficients["k3"]:
        model = "FULL_OPENCV"
    (fx, _, cx), (_, fy, cy) = camera.camera_matrix[:2].tolist()
    values = {"fx": fx, "fy": fy, "cx": cx + 0.5, "cy": cy + 0.5, **coefficients}
    parameters = (repr(values.get(name, 0.0)) for name in MODELS[model][2].split())
    width, height = camera.image_size
    return f"{number} {model} {width} {height} {' '.join(parameters)}"
