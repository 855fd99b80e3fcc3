"""COLMAP's camera models: their numbers, their parameters, and what holds them here.

Most are lenses of `rigs.lens`; cameras of others become tables of rays, by these inverses. With
``u`` an image point and ``r`` its radius, in focal lengths::

    FOV                 the ray leans by tan(r omega) / (2 tan(omega / 2)) from the axis
    DIVISION            the ray is (u, 1 + k r^2)
    THIN_PRISM_FISHEYE  OpenCV's thin prism, undone, is the ray's angle times its direction across

Source: ``src/colmap/sensor/models`` at https://github.com/colmap/colmap; Devernay and Faugeras,
"Straight lines have to be straight" (2001), for FOV.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.formats._lens import SLOTS, behind_fisheye, check_table_size, sphere, table_of
from rigs.formats._values import as_count, errors_of, numbers_of_line, one_of
from rigs.geometry.image_checks import pixel_centres
from rigs.lens import Distortion

#: Of every model: its number in binary files, what holds it here ("table": rays; nothing: no
#: camera can), and its parameters in their order.
MODELS: dict[str, tuple[int, str, str]] = {
    "SIMPLE_PINHOLE": (0, "none", "f cx cy"),
    "PINHOLE": (1, "none", "fx fy cx cy"),
    "SIMPLE_RADIAL": (2, "brown", "f cx cy k1"),
    "RADIAL": (3, "brown", "f cx cy k1 k2"),
    "OPENCV": (4, "brown", "fx fy cx cy k1 k2 p1 p2"),
    "OPENCV_FISHEYE": (5, "fisheye", "fx fy cx cy k1 k2 k3 k4"),
    "FULL_OPENCV": (6, "rational", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "FOV": (7, "table", "fx fy cx cy omega"),
    "SIMPLE_RADIAL_FISHEYE": (8, "fisheye", "f cx cy k1"),
    "RADIAL_FISHEYE": (9, "fisheye", "f cx cy k1 k2"),
    "THIN_PRISM_FISHEYE": (10, "table", "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, "", "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3"),
    "SIMPLE_DIVISION": (12, "table", "f cx cy k"),
    "DIVISION": (13, "table", "fx fy cx cy k"),
    "SIMPLE_FISHEYE": (14, "fisheye", "f cx cy"),
    "FISHEYE": (15, "fisheye", "fx fy cx cy"),
    "EUCM": (16, "table", "fx fy cx cy alpha beta"),
    "EQUIRECTANGULAR": (17, "", "w h"),
}
_LOST = {
    "RAD_TAN_THIN_PRISM_FISHEYE": "its tangential, prism and highest radial terms",
    "EQUIRECTANGULAR": "all of the sphere that is not in front",
}
_PRISM = ("k1", "k2", "k3", "p1", "p2", "sx1", "sy1")
_SLOTS = {**SLOTS, "brown": SLOTS["brown"][:4]}


@dataclass(frozen=True)
class Sensor:
    """A line of ``cameras.txt``: a camera without its pose, a pinhole where it has no lens.

    ``finish`` makes the posed camera's table of rays where it needs one.
    """

    camera: Camera
    finish: Callable[[Camera], CameraLike]


def _unchanged(camera: Camera) -> CameraLike:
    return camera


def _with_rays(camera: Camera, model: str, values: tuple[tuple[str, float], ...]) -> CameraLike:
    with errors_of(f"camera {camera.name}"):
        check_table_size(camera.image_size)
    K = camera.camera_matrix
    plane = (pixel_centres(camera.image_size) - K[:2, 2]) / np.diag(K)[:2]
    return table_of(camera, _directions(model, dict(values), plane))


def read_sensor(number: str, words: Sequence[str]) -> Sensor:
    """Return the camera of a line of ``cameras.txt``, without its number."""
    with errors_of(f"camera {number}"):
        model = one_of(words[0], MODELS, "MODEL")
        parameters = MODELS[model][2].split()
        values = dict(zip(parameters, numbers_of_line(words[3:], parameters), strict=True))
        size = as_count(words[1], "WIDTH"), as_count(words[2], "HEIGHT")
        distortion = _lens_of(model, values)
        fx, fy = (values[key if key in values else "f"] for key in ("fx", "fy"))
        K = [[fx, 0.0, values["cx"] - 0.5], [0.0, fy, values["cy"] - 0.5], [0.0, 0.0, 1.0]]
    camera = Camera(number, size, K, distortion or Distortion(), status="calibrated")
    if distortion:
        return Sensor(camera, _unchanged)
    return Sensor(camera, partial(_with_rays, model=model, values=tuple(values.items())))


def _lens_of(model: str, values: Mapping[str, float]) -> Distortion | None:
    """Return the lens of a model's parameters, or None where only a table of rays holds it."""
    _, kind, _ = MODELS[model]
    if model == "THIN_PRISM_FISHEYE" and not any(values[k] for k in ("p1", "p2", "sx1", "sy1")):
        kind = "fisheye"
    if model == "RAD_TAN_THIN_PRISM_FISHEYE" and not any(list(values.values())[8:]):
        return Distortion("fisheye", tuple(values[f"k{i}"] for i in range(4)))
    if kind in _SLOTS:
        return Distortion(kind, tuple(values.get(name, 0.0) for name in _SLOTS[kind]))
    if not kind:
        raise ValueError(
            f"MODEL: found {model}, expected one that a camera here can hold: {_LOST[model]} "
            "would be lost; colmap image_undistorter makes images of PINHOLE"
        )
    if model == "THIN_PRISM_FISHEYE" and values["k4"]:
        raise ValueError(
            f"PARAMS: found k4 {values['k4']} beside p1, p2, sx1 or sy1, expected 0: its term of "
            "the eighth power would be lost"
        )
    if model == "FOV" and not abs(values["omega"]) < np.pi:
        raise ValueError(f"PARAMS: found omega {values['omega']}, expected less than pi radians")
    if values.get("omega", values.get("k")) == 0:
        return Distortion()  # both are then a pinhole
    return None


def _directions(
    model: str, values: Mapping[str, float], plane: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return unit vectors ``(N, 3)`` seen at ``plane`` ``(N, 2)``, in focal lengths; or NaN."""
    if model == "EUCM":
        return sphere("eucm", (values["alpha"], values["beta"]), plane)
    radius = np.linalg.norm(plane, axis=1, keepdims=True)
    if model == "FOV":
        omega = abs(values["omega"])
        angle = np.where(radius * omega < np.pi / 2, radius * omega, np.nan)
        across, forward = np.tan(angle), 2 * np.tan(omega / 2) * radius
        # the axis, where both are zero, looks straight ahead
        seen = np.where(radius > 0, np.hstack([plane * across, forward]), [0.0, 0.0, 1.0])
    elif model == "THIN_PRISM_FISHEYE":
        k1, k2, k3, p1, p2, s1, s3 = (values[name] for name in _PRISM)
        prism = Distortion("thin_prism", (k1, k2, p1, p2, k3, 0, 0, 0, s1, 0, s3, 0))
        seen = prism.unproject(plane)
        seen = behind_fisheye(seen[:, :2] / seen[:, 2:])
    else:
        forward = 1 + values["k"] * radius**2
        seen = np.hstack([plane, np.where(forward > 0, forward, np.nan)])
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)
