"""OpenPTV's calibrations: ``.ori`` and ``.addpar`` of each calibration image, and ``ptv.par``.

Read only, given the project's folder, one in it (``cal``, ``parametersRun1``), its ``ptv.par``,
pyptv's ``parameters_Run1.yaml``, or one ``.ori`` or ``.addpar``. 3D-PTV's ``ptv.par`` names four
cameras whatever their number, and its first ones have a flag less; older ``.ori`` lack the glass.
With ``D = Rx Ry Rz`` of omega, phi, kappa (the matrix in the file is a copy of few digits),
``d = D^T (X - X0)``, x to the right and y up on the sensor in mm::

    x = xh - cc d[0] / d[2],   y = yh - cc d[1] / d[2]
    x += x (k1 q + k2 q^2 + k3 q^3) + p1 (q + 2 x^2) + 2 p2 x y,   q = x^2 + y^2
    y += y (k1 q + k2 q^2 + k3 q^3) + p2 (q + 2 y^2) + 2 p1 x y
    column = imx / 2 + (scx x - sin(she) y) / pix_x,   row = imy / 2 - cos(she) y / pix_y

and (0.5, 0.5) is the centre of the top-left pixel. That is 3D-PTV's and liboptv's formula; since
optv 0.3 scx stretches the row too. It is Brown's lens where its centre is the principal point
(xh = yh = 0, or no distortion); else, and behind glass, the camera becomes a table of rays. Glass
has its inner face at ``n . X = |G|``, with G the ``.ori``'s glass vector from the world's origin
and n its direction; its outer face lies d further towards the camera. A direction's part
across n is multiplied by n1 / n2 at the outer face and n2 / n3 at the inner one. Source:
``imgcoord.c``, ``trafo.c``, ``calibration.c``, ``parameters.c`` and ``ray_tracing.c`` at
https://github.com/OpenPTV/openptv, ``jw_ptv.c`` at https://github.com/3dptv/3dptv,
``parameter_manager.py`` at https://github.com/alexlib/pyptv.
"""

from __future__ import annotations

import logging
import math
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.files.text import read_text, read_yaml_mapping, shortened
from rigs.formats._lens import check_table_size, limited
from rigs.formats._values import (
    as_count,
    as_mapping,
    as_number,
    errors_of,
    errors_of_file,
    numbers_of_line,
    read_head,
    required,
)
from rigs.geometry.image_checks import pixel_centres
from rigs.geometry.rotation import matrix_of_angles
from rigs.lens import Distortion
from rigs.ray_table import RayTable
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_EXTERIOR = ("x0", "y0", "z0", "omega", "phi", "kappa")
_TURN = tuple(f"dm{i}{j}" for i in "012" for j in "012")
_INTERIOR = ("xh", "yh", "cc")
_GLASS = ("glass_x", "glass_y", "glass_z")
_LENS = ("k1", "k2", "k3", "p1", "p2", "scx", "she")
_MEDIA = ("n1", "n2", "n3", "d")
_SENSOR = ("imx", "imy", "pix_x", "pix_y", "chfield", *_MEDIA)
_PAR, _CAMERA = "ptv.par", (".ori", ".addpar")
_FLAGS = 3  # lines of 0 or 1 before the sensor: filter, all cameras (not in old files), TIFF
_TCL_ROWS = 4  # cameras that 3D-PTV's files name


@dataclass(frozen=True)
class _Project:
    """Contents of ``ptv.par``: the cameras' images and their common sensor."""

    images: tuple[str, ...]
    size: tuple[int, int]
    pitch: tuple[float, float]
    media: tuple[float, float, float, float]  # indices before, in and behind glass; its mm


def looks_like(path: Path, head: str) -> bool:
    """Return whether a path is a project, a folder of it, its parameters or a camera."""
    if path.is_dir():
        return bool(_parameters_in(path)) or any(path.glob("*.ori"))
    return path.suffix in _CAMERA or path.name == _PAR or _is_yaml(path, head)


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a project, or of one ``.ori`` in it."""
    parameters = _parameters(path)
    projects = [_read_project(file) for file in parameters]
    for file, project in zip(parameters, projects, strict=True):
        if project != projects[0]:
            raise ValueError(
                f"{path}: found other cameras or sensors in {file} than in {parameters[0]}, "
                "expected one of them as IN"
            )
    root = parameters[0].parent
    root = root.parent if root.name.startswith("parameters") else root
    single = path.suffix in _CAMERA and path.is_file()
    files = [root / f"{image}.ori" for image in projects[0].images]
    files = [path.with_suffix(".ori")] if single else files
    cameras = limited(_read_camera(file, projects[0]) for file in files)
    return Rig(cameras, "mm", f"as in {path.name}")


def _parameters(path: Path) -> list[Path]:
    """Return the files of parameters that belong to a path: of the first folder with any."""
    if path.is_file() and path.suffix not in _CAMERA:
        return [path]
    folders = [path, path.parent] if path.is_dir() else [path.parent, path.parent.parent]
    for folder in folders:
        if found := _parameters_in(folder):
            return found
    raise FileNotFoundError(
        f"{path}: found no {_PAR} in it, in parameters or beside it, nor a parameters_*.yaml: one "
        "of them holds the sensor's size and pixel pitch"
    )


def _parameters_in(folder: Path) -> list[Path]:
    """Return the files of parameters in a project's folder, or in one of parameters."""
    if (folder / _PAR).is_file():
        return [folder / _PAR]
    found = sorted(folder.glob(f"parameters*/{_PAR}"))
    found += [file for file in sorted(folder.glob("*.y*ml")) if file.is_file()]
    return [file for file in found if file.name == _PAR or _is_yaml(file, read_head(file))]


def _is_yaml(path: Path, head: str) -> bool:
    """Return whether a file is pyptv's YAML of parameters."""
    return path.suffix in (".yaml", ".yml") and bool(
        re.search(r"^num_cams\s*:", head, re.MULTILINE)
        and re.search(r"^ptv\s*:", head, re.MULTILINE)
    )


def _read_project(file: Path) -> _Project:
    """Return the contents of a ``ptv.par``, or of pyptv's YAML."""
    with errors_of_file(file):
        images, values = _of_yaml(file) if file.name != _PAR else _of_par(file)
        for image in images:
            if ".." in PurePosixPath(image).parts or PurePosixPath(image).is_absolute():
                raise ValueError(f"calibration image: found {image!r}, expected a path inside")
        size = as_count(values["imx"], "imx"), as_count(values["imy"], "imy")
        for key in ("pix_x", "pix_y"):
            if not values[key] > 0:
                raise ValueError(f"{key}: found {values[key]}, expected a positive length")
        if values["chfield"] != 0:
            raise ValueError(f"chfield: found {values['chfield']:g}, expected 0: whole frames")
        n1, n2, n3, d = (values[key] for key in _MEDIA)
        if not min(n1, n2, n3) > 0:
            raise ValueError(f"n1, n2, n3: found {[n1, n2, n3]}, expected positive indices")
        if not d >= 0:
            raise ValueError(f"d: found {d}, expected a thickness >= 0")
        media = n1, n2, n3, d
    return _Project(tuple(images), size, (values["pix_x"], values["pix_y"]), media)


def _of_par(file: Path) -> tuple[list[str], dict[str, float]]:
    """Return the calibration images and the sensor of a ``ptv.par``."""
    words = [line.strip() for line in read_text(file).splitlines() if line.strip()]
    count = as_count(words[0] if words else None, "number of cameras")
    rows = count
    if count < _TCL_ROWS and not all(map(_is_number, words[1 + 2 * count : 3 + 2 * count])):
        rows = _TCL_ROWS
    images = [name.replace("\\", "/") for name in words[2 : 2 + 2 * count : 2]]
    rest = words[1 + 2 * rows :]
    flags = [word in ("0", "1") for word in rest[:_FLAGS]]
    rest = rest[flags.index(False) if False in flags else _FLAGS :]
    if len(rest) < len(_SENSOR):
        raise ValueError(
            f"found {len(words)} lines, expected {1 + 2 * rows + _FLAGS + len(_SENSOR)} "
            f"for {count} cameras: their images in twos, flags, {' '.join(_SENSOR)}"
        )
    return images, dict(zip(_SENSOR, numbers_of_line(rest[: len(_SENSOR)], _SENSOR), strict=True))


def _of_yaml(file: Path) -> tuple[list[str], dict[str, float]]:
    """Return the calibration images and the sensor of pyptv's YAML."""
    data = read_yaml_mapping(file)
    count = as_count(required(data, "num_cams"), "num_cams")
    ptv = as_mapping(required(data, "ptv"), "ptv")
    with errors_of("ptv"):
        listed = required(ptv, "img_cal")
        if not isinstance(listed, list) or len(listed) < count:
            raise ValueError(f"img_cal: found {shortened(listed)}, expected {count} images")
        if not all(isinstance(name, str) and name for name in listed[:count]):
            raise ValueError(f"img_cal: found {shortened(listed)}, expected names of images")
        images = [name.replace("\\", "/") for name in listed[:count]]
        keys = {key: f"mmp_{key}" if key in _MEDIA else key for key in _SENSOR}
        return images, {key: as_number(required(ptv, name), name) for key, name in keys.items()}


def _is_number(word: str) -> bool:
    """Return whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _read_camera(file: Path, project: _Project) -> CameraLike:
    """Return the camera of an ``.ori`` and of its ``.addpar``, if there is one."""
    names = (*_EXTERIOR, *_TURN, *_INTERIOR)
    with errors_of_file(file):
        words = read_text(file).split()
        names += _GLASS if len(words) > len(names) else ()
        values = dict(zip(names, numbers_of_line(words[: len(names)], names), strict=True))
    lens = dict.fromkeys(_LENS, 0.0) | {"scx": 1.0}
    addpar = file.with_suffix(".addpar")
    if addpar.is_file():
        with errors_of_file(addpar):
            words = read_text(addpar).split()
            lens = dict(zip(_LENS, numbers_of_line(words[: len(_LENS)], _LENS), strict=True))
    name = PurePosixPath(file.stem).stem or file.stem  # cal/cam1.tif.ori
    with errors_of_file(file), errors_of(f"camera {name}"):
        camera = _camera(name, values, lens, project)
        if len(set(project.media[:3])) == 1:  # rays do not bend
            return camera
        glass = np.array([required(values, key, "the way to the glass") for key in _GLASS])
        return _behind_glass(camera, glass, project.media)


def _camera(
    name: str, values: dict[str, float], lens: dict[str, float], project: _Project
) -> CameraLike:
    """Return the camera of a file's values."""
    cc = values["cc"]
    if not cc > 0:
        raise ValueError(f"cc: found {cc}, expected a positive length")
    if not (lens["scx"] > 0 and math.cos(lens["she"]) > 0):
        raise ValueError(f"scx, she: found {lens['scx']}, {lens['she']}, expected > 0, < pi/2")
    R = np.diag([1.0, -1.0, -1.0]) @ matrix_of_angles(*(values[key] for key in _EXTERIOR[3:])).T
    position = np.array([values[key] for key in _EXTERIOR[:3]])
    (pix_x, pix_y), (width, height) = project.pitch, project.size
    if lens["scx"] != 1:
        logger.warning(
            "camera %s: scx: found %g, taken as 3D-PTV and liboptv do, which stretch columns "
            "alone: optv 0.3 stretches rows too, up to %.2g px at the image's edge",
            name,
            lens["scx"],
            abs(lens["scx"] - 1) * height / 2,
        )
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


def _behind_glass(
    camera: CameraLike, glass: NDArray[np.float64], media: tuple[float, float, float, float]
) -> RayTable:
    """Return the table of a camera's rays behind a window at ``glass``, in mm from the origin."""
    n1, n2, n3, thickness = media
    distance = float(np.linalg.norm(glass))
    if not 0 < distance < np.inf:
        raise ValueError(f"glass_x, glass_y, glass_z: found {glass.tolist()}, expected a vector")
    check_table_size(camera.image_size)
    normal = glass / distance
    origins, directions = camera.rays(pixel_centres(camera.image_size))
    height = origins[0] @ normal - distance - thickness
    if not height > 0:
        raise ValueError(
            f"glass_x, glass_y, glass_z: found {glass.tolist()}, a window {-height:.6g} mm behind "
            "the camera, expected one before it"
        )
    with np.errstate(invalid="ignore", divide="ignore"):
        towards = np.where(directions @ normal < 0, -(directions @ normal), np.nan)[:, None]
        outer = origins + directions * (height / towards)
        inside = _bent(directions, normal, n1 / n2)
        inner = outer + inside * (thickness / -(inside @ normal))[:, None]
        seen = _bent(inside, normal, n2 / n3)
    lost = ~np.isfinite(inner + seen).all(axis=1)
    inner[lost], seen[lost] = 0.0, np.nan
    shape = (*camera.image_size[::-1], 3)
    return RayTable(camera.name, inner.reshape(shape), seen.reshape(shape), status="calibrated")


def _bent(
    directions: NDArray[np.float64], normal: NDArray[np.float64], ratio: float
) -> NDArray[np.float64]:
    """Return unit directions ``(N, 3)`` behind a face, against its normal; NaN if reflected."""
    across = ratio * (directions - (directions @ normal)[:, None] * normal)
    return across - np.sqrt(1 - np.sum(across**2, axis=1, keepdims=True)) * normal
