"""Agisoft Metashape's ``cameras.xml``: sensors, and cameras with their poses in a chunk.

A camera's ``transform`` is 4 x 4, camera to chunk, OpenCV's axes. The chunk's, or its
component's, ``transform`` (rotation, translation, scale) then leads to the world and is applied:
lengths are metres where ``reference`` names a system in metres, else without a unit. The lens is::

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 x^2) + 2 p2 x y
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p2 (r^2 + 2 y^2) + 2 p1 x y
    u = width / 2 + cx + x' (f + b1) + y' b2,   v = height / 2 + cy + y' f

with (0.5, 0.5) the centre of the top-left pixel: OpenCV's with p1 and p2 exchanged and ``b2`` as
skew. Sensors of type ``fisheye`` are equidistant, k1 to k4 as OpenCV's. Where no lens here equals
it the camera becomes a table of rays. Sources: appendix "Camera models" of the Metashape user
manual; exports of 1.5 and later.
"""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.files.text import shortened
from rigs.files.units import UNKNOWN
from rigs.files.xml_file import read_xml
from rigs.formats._lens import metashape_table
from rigs.formats._values import (
    as_array,
    as_count,
    as_number,
    as_rotation,
    errors_of,
    rotation_of_motion,
)
from rigs.formats._views import Views
from rigs.lens import Distortion
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_LENS = ("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")
#: Our model of each type of sensor, and the coefficients of it in our order.
_TYPES = {
    "frame": ("brown", ("k1", "k2", "p2", "p1", "k3")),
    "fisheye": ("fisheye", ("k1", "k2", "k3", "k4")),
}
#: A local system in metres, or a geographic one, for which chunks lead to geocentric metres.
_METRES = re.compile(
    r'^\s*(?:GEOGCS|PROJCS|GEOCCS|COMPD_CS|LOCAL_CS.*UNIT\["metre",1[,.\]])', re.S
)
Similarity = tuple[float, NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True)
class Sensor:
    """A sensor's type, size, camera matrix, lens (None: a table of rays) and coefficients."""

    kind: str
    size: tuple[int, int]
    matrix: tuple[tuple[float, float, float], ...]
    distortion: Distortion | None
    lens: tuple[tuple[str, float], ...]


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file is a Metashape document with sensors."""
    return path.suffix.lower() == ".xml" and "<document" in head and "<sensor" in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``cameras.xml``."""
    root = read_xml(path)
    chunks = [c for c in root.iter("chunk") if c.find("sensors") is not None]
    if len(chunks) != 1:
        raise ValueError(f"chunk: found {len(chunks)}, expected one: export the active chunk")
    chunk = chunks[0]
    sensors = {e.get("id"): e for e in chunk.iterfind("sensors/sensor")}
    worlds = {e.get("id"): e.find("transform") for e in chunk.iterfind("components/component")}
    views, lost, scaled = Views(path), [], set()
    for element in chunk.iterfind("cameras//camera"):
        label = element.get("label") or f"camera{element.get('id')}"
        is_posed, is_on = element.find("transform") is not None, element.get("enabled")
        if not is_posed and element.get("master_id") not in (None, element.get("id")):
            raise ValueError(
                f"camera {label}: transform: missing, as of a slave of a multi-camera system, "
                "expected one of its own: export the cameras as COLMAP or Bundler"
            )
        if not is_posed or is_on in ("0", "false"):
            lost.append(label)
            continue
        with errors_of(f"camera {label}"):
            world = worlds.get(element.get("component_id"))
            world = chunk.find("transform") if world is None else world
            scaled.add(world is not None)
            camera, sensor = _camera(element, sensors, _similarity(world))
            finish = partial(_with_rays, sensor=sensor)
            views.add(label.strip().lstrip("/\\") or "camera", camera, None, finish)
            _report_orientation(path, label, element.findtext("orientation"))
    _check(path, views.images, lost, scaled)
    frame = "as in Metashape's chunk" + (", its transform applied" if True in scaled else "")
    is_metric = True in scaled and _METRES.search(chunk.findtext("reference") or "")
    return views.rig("m" if is_metric else UNKNOWN, frame)


def _check(path: Path, images: list, lost: list[str], scaled: set[bool]) -> None:
    """Refuse a chunk without poses or with some in the world and some not; name what is lost."""
    if not images:
        raise ValueError(
            f"cameras: found none with a transform among {len(lost)}, expected aligned cameras: "
            "align them in Metashape and export again"
        )
    if len(scaled) > 1:
        raise ValueError(
            "component: found some with a transform to the world and some without, expected all "
            "in one system: export one component"
        )
    if lost:
        logger.warning("%s: left out %d cameras that are disabled or not aligned: %s", path,
                       len(lost), shortened(", ".join(lost)))  # fmt: skip


def _report_orientation(path: Path, label: str, found: str | None) -> None:
    """Report a turned image; its array is read as stored, as Metashape's sensors are."""
    if (found or "1").strip() != "1":
        logger.warning("%s: camera %s: orientation: found %s: pixels are taken as stored", path,
                       label, found)  # fmt: skip


def _with_rays(camera: Camera, sensor: Sensor) -> CameraLike:
    """Return a camera as it is, or as a table of rays where it has no lens for its sensor's."""
    if sensor.distortion is not None:
        return camera
    with errors_of(f"camera {camera.name}"):
        return metashape_table(camera, dict(sensor.lens), sensor.kind == "fisheye")


def _camera(element: Element, sensors: dict, world: Similarity) -> tuple[Camera, Sensor]:
    """Return the camera of an element in the world, under a placeholder name, and its sensor."""
    if element.get("sensor_id") not in sensors:
        raise ValueError(f"sensor_id: found {element.get('sensor_id')}, expected one of <sensors>")
    sensor = sensors[element.get("sensor_id")]
    with errors_of(f"sensor {sensor.get('id')}"):
        sensor = _sensor(sensor)
    motion = _numbers(element, "transform", 16).reshape(4, 4)
    to_chunk = rotation_of_motion(motion, "transform")
    scale, turn, shift = world
    R = (turn @ to_chunk).T
    position = scale * turn @ motion[:3, 3] + shift
    distortion = sensor.distortion or Distortion()
    camera = Camera("camera", sensor.size, sensor.matrix, distortion, R, -R @ position,
                    status="calibrated")  # fmt: skip
    return camera, sensor


def _sensor(sensor: Element) -> Sensor:
    """Return a sensor by its adjusted calibration."""
    kind = sensor.get("type")
    if kind not in _TYPES:
        raise ValueError(
            f"type: found {kind!r}, expected frame or fisheye (equidistant): choose one in "
            "Metashape's camera calibration, align and export again"
        )
    found = sensor.findall("calibration")
    adjusted = [c for c in found if c.get("class") == "adjusted"]
    calibration = next(iter(adjusted or found), None)
    if calibration is None:
        raise ValueError(
            "calibration: missing, expected f and the lens: optimise the cameras in Metashape "
            "and export again"
        )
    if calibration.get("type", kind) != kind:
        raise ValueError(f"calibration type: found {calibration.get('type')!r}, expected {kind}")
    resolution = calibration.find("resolution")
    resolution = sensor.find("resolution") if resolution is None else resolution
    if resolution is None:
        raise ValueError("resolution: missing, expected width and height")
    size = as_count(resolution.get("width"), "width"), as_count(resolution.get("height"), "height")
    f = _number(calibration, "f", None)
    cx, cy, b1, b2 = (_number(calibration, key, 0.0) for key in ("cx", "cy", "b1", "b2"))
    lens = {key: _number(calibration, key, 0.0) for key in _LENS}
    model, order = _TYPES[kind]
    K = ((f + b1, b2, size[0] / 2 + cx - 0.5), (0.0, f, size[1] / 2 + cy - 0.5), (0.0, 0.0, 1.0))
    distortion = Distortion(model, tuple(lens[key] for key in order))
    if any(value for key, value in lens.items() if key not in order):
        distortion = None
    elif model == "brown" and not any(lens.values()):
        distortion = Distortion()
    return Sensor(kind, size, K, distortion, tuple(lens.items()))


def _similarity(element: Element | None) -> Similarity:
    """Return scale, rotation and translation from the chunk to the world."""
    if element is None:
        return 1.0, np.eye(3), np.zeros(3)
    with errors_of("chunk's transform"):
        if element.find("rotation") is None:  # older files: one matrix of all three
            motion = as_array((element.text or "").split(), (16,), "matrix").reshape(4, 4)
            scale = float(np.cbrt(max(np.linalg.det(motion[:3, :3]), 0.0)))
            turn, shift = motion[:3, :3] / (scale or 1.0), motion[:3, 3]
        else:
            scale = _number(element, "scale", 1.0)
            turn = _numbers(element, "rotation", 9).reshape(3, 3)
            shift = _numbers(element, "translation", 3)
        if not scale > 0:
            raise ValueError(f"scale: found {scale}, expected a positive number")
        return scale, as_rotation(turn, "rotation"), shift


def _number(element: Element, key: str, default: float | None) -> float:
    """Return the number that a child holds."""
    text = element.findtext(key)
    if text is None and default is None:
        raise ValueError(f"{key}: missing, expected a number")
    return as_number(default if text is None else text.strip(), key)


def _numbers(element: Element, key: str, count: int) -> NDArray[np.float64]:
    """Return the numbers that a child holds."""
    text = element.findtext(key)
    if text is None:
        raise ValueError(f"{key}: missing, expected {count} numbers")
    return as_array(text.split(), (count,), key)
