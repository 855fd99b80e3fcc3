"""OpenPTV's calibrations: ``.ori`` and ``.addpar`` of each calibration image, and ``ptv.par``.

Read only, given the project's folder, its ``parameters/ptv.par``, or one ``.ori`` inside it. With
``D`` the rotation of the angles omega, phi, kappa (``D = Rx Ry Rz``; the matrix in the file is a
copy of few digits), ``d = D^T (X - X0)``, x to the right and y up on the sensor in mm::

    x = xh - cc d[0] / d[2],   y = yh - cc d[1] / d[2]
    x += x (k1 q + k2 q^2 + k3 q^3) + p1 (q + 2 x^2) + 2 p2 x y,   q = x^2 + y^2
    y += y (k1 q + k2 q^2 + k3 q^3) + p2 (q + 2 y^2) + 2 p1 x y
    column = imx / 2 + (scx x - sin(she) y) / pix_x,   row = imy / 2 - cos(she) y / pix_y

and (0.5, 0.5) is the centre of the top-left pixel. That is Brown's lens where its centre is the
principal point (xh = yh = 0, or no distortion); else the camera becomes a table of rays. Lengths
are in mm. Glass (an index of refraction other than 1) bends rays and is refused.
Source: ``liboptv/src/{imgcoord,trafo,calibration,segmentation,parameters}.c`` at
https://github.com/OpenPTV/openptv; Dracos (ed.), "Three-Dimensional Velocity and Vorticity
Measuring and Image Analysis Techniques" (1996).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.files.text import read_text
from rigs.formats._image_size import check_table_size
from rigs.formats._values import as_count, as_number, errors_of, errors_of_file, numbers_of_line
from rigs.geometry.image_checks import pixel_centres
from rigs.geometry.rotation import matrix_of_angles
from rigs.lens import Distortion
from rigs.ray_table import RayTable
from rigs.rig import Rig

LENGTH_UNIT = "mm"
_EXTERIOR = ("x0", "y0", "z0", "omega", "phi", "kappa")
_TURN = tuple(f"dm{i}{j}" for i in "012" for j in "012")
_INTERIOR = ("xh", "yh", "cc")
_GLASS = ("glass_x", "glass_y", "glass_z")
_LENS = ("k1", "k2", "k3", "p1", "p2", "scx", "she")
_SENSOR = ("imx", "imy", "pix_x", "pix_y", "chfield", "n1", "n2", "n3", "d")


@dataclass(frozen=True)
class _Project:
    """Contents of ``ptv.par``: the cameras' images and their common sensor."""

    images: tuple[str, ...]
    size: tuple[int, int]
    pitch: tuple[float, float]


def looks_like(path: Path, head: str) -> bool:
    """Return whether a path is a project, its ``ptv.par`` or a camera of it."""
    if path.is_dir():
        return (path / "parameters" / "ptv.par").is_file() or (path / "ptv.par").is_file()
    return path.suffix == ".ori" or path.name == "ptv.par"


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a project, or of one ``.ori`` in it.

    Raises
    ------
    FileNotFoundError
        If a file of the project is missing.
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    parameters = _parameters(path)
    project = _read_project(parameters)
    root = parameters.parent
    root = root.parent if root.name == "parameters" else root
    files = [path] if path.suffix == ".ori" else [root / f"{i}.ori" for i in project.images]
    cameras = [_read_camera(file, project) for file in files]
    with errors_of_file(path):
        return Rig(tuple(cameras), LENGTH_UNIT, f"as in {path.name}")


def _parameters(path: Path) -> Path:
    """Return the ``ptv.par`` that belongs to a path."""
    if path.name == "ptv.par":
        return path
    folders = [path] if path.is_dir() else [path.parent, path.parent.parent]
    for folder in folders:
        for file in (folder / "parameters" / "ptv.par", folder / "ptv.par"):
            if file.is_file():
                return file
    raise FileNotFoundError(
        f"{path}: found no parameters/ptv.par with it, which holds the sensor's size"
    )


def _read_project(file: Path) -> _Project:
    """Return the contents of a ``ptv.par``."""
    with errors_of_file(file):
        words = [line.strip() for line in read_text(file).splitlines() if line.strip()]
        count = as_count(words[0] if words else None, "number of cameras")
        if len(words) < 1 + 2 * count + 3 + len(_SENSOR):
            raise ValueError(
                f"found {len(words)} lines, expected {13 + 2 * count} for {count} cameras"
            )
        images = [name.replace("\\", "/") for name in words[2 : 2 + 2 * count : 2]]
        for image in images:
            if ".." in PurePosixPath(image).parts or PurePosixPath(image).is_absolute():
                raise ValueError(f"calibration image: found {image!r}, expected a path inside")
        rest = words[4 + 2 * count : 4 + 2 * count + len(_SENSOR)]
        values = dict(zip(_SENSOR, numbers_of_line(rest, _SENSOR), strict=True))
        size = as_count(values["imx"], "imx"), as_count(values["imy"], "imy")
        for key in ("pix_x", "pix_y"):
            if not values[key] > 0:
                raise ValueError(f"{key}: found {values[key]}, expected a positive length")
        if values["chfield"] != 0:
            raise ValueError(f"chfield: found {values['chfield']:g}, expected 0: whole frames")
        if any(values[key] != 1 for key in ("n1", "n2", "n3")):
            indices = [values[key] for key in ("n1", "n2", "n3")]
            raise ValueError(
                f"n1, n2, n3: found refraction indices {indices}, expected 1: rays "
                "through glass or water are bent, which no camera model here describes"
            )
    return _Project(tuple(images), size, (values["pix_x"], values["pix_y"]))


def _read_camera(file: Path, project: _Project) -> CameraLike:
    """Return the camera of an ``.ori`` and of its ``.addpar``, if there is one."""
    names = (*_EXTERIOR, *_TURN, *_INTERIOR, *_GLASS)
    with errors_of_file(file):
        words = read_text(file).split()
        values = dict(zip(names, numbers_of_line(words[: len(names)], names), strict=True))
    lens = dict.fromkeys(_LENS, 0.0) | {"scx": 1.0}
    addpar = file.with_suffix(".addpar")
    if addpar.is_file():
        with errors_of_file(addpar):
            words = read_text(addpar).split()
            lens = dict(zip(_LENS, numbers_of_line(words[: len(_LENS)], _LENS), strict=True))
    name = PurePosixPath(file.stem).stem or file.stem  # cal/cam1.tif.ori
    with errors_of_file(file), errors_of(f"camera {name}"):
        return _camera(name, values, lens, project)


def _camera(
    name: str, values: dict[str, float], lens: dict[str, float], project: _Project
) -> CameraLike:
    """Return the camera of a file's values."""
    cc = as_number(values["cc"], "cc")
    if not cc > 0:
        raise ValueError(f"cc: found {cc}, expected a positive length")
    if not (lens["scx"] > 0 and math.cos(lens["she"]) > 0):
        raise ValueError(
            f"scx, she: found {lens['scx']} and {lens['she']}, expected a scale and a small angle"
        )
    R = np.diag([1.0, -1.0, -1.0]) @ matrix_of_angles(*(values[key] for key in _EXTERIOR[3:])).T
    position = np.array([values[key] for key in _EXTERIOR[:3]])
    (pix_x, pix_y), (width, height) = project.pitch, project.size
    scale, sin, cos = lens["scx"], math.sin(lens["she"]), math.cos(lens["she"])
    K = np.array(  # relative to the sensor's middle; y points up there
        [
            [scale * cc / pix_x, sin * cc / pix_x, width / 2 - 0.5],
            [0.0, cos * cc / pix_y, height / 2 - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )
    shift = np.array([values["xh"], -values["yh"]]) / cc
    k1, k2, k3, p1, p2 = (lens[key] for key in ("k1", "k2", "k3", "p1", "p2"))
    # OpenPTV's are in mm on the sensor, OpenCV's in tangents; y down changes p2's sign
    brown = (k1 * cc**2, k2 * cc**4, -p2 * cc, p1 * cc, k3 * cc**6)
    distortion = Distortion("brown", brown) if any(brown) else Distortion()
    if any(brown) and shift.any():
        check_table_size(project.size)
        uv = pixel_centres(project.size)
        seen = distortion.unproject((uv - K[:2, 2]) @ np.linalg.inv(K[:2, :2]).T)
        seen = np.concatenate([seen[:, :2] / seen[:, 2:] - shift, np.ones((len(uv), 1))], axis=1)
        directions = (seen @ R).reshape(height, width, 3)
        return RayTable(name, position, directions, status="calibrated")
    K[:2, 2] += K[:2, :2] @ shift
    return Camera(name, project.size, K, distortion, R, -R @ position, status="calibrated")
