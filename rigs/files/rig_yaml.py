"""Reading rig.yaml."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, cast

from rigs.camera import Camera, look_at
from rigs.camera_protocol import CameraLike
from rigs.figures import Accuracy, Optics
from rigs.files.schema import CameraEntry, RigEntry, SceneEntry, parse_rig
from rigs.files.text import read_yaml_mapping
from rigs.files.units import UNKNOWN, metres
from rigs.layouts import matrix_of_lens, optics_of_lens
from rigs.lens import Distortion
from rigs.ray_table import RayTable
from rigs.ray_table.ray_file import load_ray_table
from rigs.rig import Rig, Volume
from rigs.scene.entry import scene_of
from rigs.scene.scene import Scene

HEAD = {"format": "emission-rig", "version": 1}
"""The first entries of a file."""


def load_rig(path: str | os.PathLike) -> Rig:
    """Return the rig in a ``rig.yaml``.

    A camera's pose is ``R`` and ``t``, or ``position``, ``look_at`` and ``up``; its intrinsics
    are ``camera_matrix``, or ``focal_length`` and ``pixel_pitch`` in one unit (with
    ``principal_point`` in pixels, by default the image's middle). Instead of both it may name a
    ``ray_table``, an ``.npz`` in the file's folder (`rigs.RayTable`). With a ``scene`` the cameras
    look through it (`rigs.scene.SceneCamera`).

    Raises
    ------
    FileNotFoundError, IsADirectoryError
        If there is no such file.
    ValueError
        In one line that names the file, the camera, the field, what was found and what was
        expected.
    """
    data = read_yaml_mapping(path)
    try:
        for field, expected in HEAD.items():
            if field not in data:
                raise ValueError(f"{field}: missing, expected {expected}")
            if data[field] != expected or isinstance(data[field], bool):
                raise ValueError(f"{field}: found {data[field]!r}, expected {expected}")
        entry = parse_rig(data)
        if entry.convention != "opencv":
            raise ValueError(f"convention: found {entry.convention!r}, expected opencv")
        return _rig(entry, Path(path).parent)
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


def load_scene(path: str | os.PathLike, length_unit: str = "mm") -> Scene:
    """Return the scene in a YAML file that holds the ``scene`` of a rig.yaml, or its contents.

    Lengths are in ``length_unit``; those of a file that names another unit are converted.
    """
    data = read_yaml_mapping(path)
    try:
        own, unit = data.get("scene", data), data.get("length_unit", UNKNOWN)
        unit = length_unit if unit == UNKNOWN else unit
        entry = parse_rig({**HEAD, "cameras": [], "scene": own, "length_unit": unit}).scene
        if entry is None or not entry.solids:
            raise ValueError("scene: found no solids, expected at least one")
        found = scene_of(entry, Path(path).parent, unit)
        same = unit == length_unit
        return found if same else found.with_lengths_scaled(metres(unit) / metres(length_unit))
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


def _rig(entry: RigEntry, folder: Path) -> Rig:
    """Return the rig of a checked file in ``folder``."""
    if not entry.cameras:
        raise ValueError("cameras: found none, expected at least one")
    box = entry.volume
    volume = None if box is None else Volume(box.shape, box.spacing, box.center)
    cameras = tuple(_camera(camera, folder) for camera in entry.cameras)
    rig = Rig(cameras, entry.length_unit, entry.world_frame, volume, entry.calibration)
    return rig if entry.scene is None else _in_scene(rig, entry.scene, folder)


def _in_scene(rig: Rig, entry: SceneEntry, folder: Path) -> Rig:
    """Return the rig whose cameras look through the scene of a checked entry."""
    from rigs.scene.entry import check_scene

    scene = scene_of(entry, folder, rig.length_unit)
    check_scene(scene, rig)
    return rig.through(scene)


def _camera(entry: CameraEntry, folder: Path) -> CameraLike:
    """Return the camera of a checked entry."""
    if entry.ray_table is not None:
        return _ray_table(entry, entry.ray_table, folder)
    try:
        if entry.image_size is None:
            raise ValueError("image_size: missing, expected width and height in pixels")
        distortion = Distortion(entry.distortion.model, tuple(entry.distortion.coefficients))
        optics, accuracy = _optics(entry), _accuracy(entry)
        K = _intrinsics(entry)
        optics = optics_of_lens(entry.focal_length, entry.pixel_pitch, optics)
        R, t = _pose(entry)
    except ValueError as error:
        raise ValueError(f"camera {entry.name}: {error}") from None
    size, status = entry.image_size, entry.status
    return Camera(entry.name, size, K, distortion, R, t, optics, status, accuracy)


def _optics(entry: CameraEntry) -> Optics | None:
    return None if entry.optics is None else Optics(**entry.optics.model_dump())


def _accuracy(entry: CameraEntry) -> Accuracy | None:
    return None if entry.accuracy is None else Accuracy(**entry.accuracy.model_dump())


def _ray_table(entry: CameraEntry, file: str, folder: Path) -> RayTable:
    """Return the table of rays in a file that an entry names."""
    kept = {"name", "ray_table", "image_size", "optics", "status", "accuracy"}
    try:
        for field in sorted(entry.model_fields_set - kept):
            raise ValueError(f"{field}: found together with ray_table, expected one of the two")
        optics, accuracy = _optics(entry), _accuracy(entry)
    except ValueError as error:
        raise ValueError(f"camera {entry.name}: {error}") from None
    camera = load_ray_table(entry.name, file, folder, optics, entry.status)
    if entry.image_size not in (None, camera.image_size):
        raise ValueError(
            f"camera {entry.name}: image_size: found {entry.image_size}, "
            f"expected {camera.image_size} as in {file}"
        )
    return camera.with_accuracy(accuracy)


def _intrinsics(entry: CameraEntry) -> Any:
    """Return the camera matrix, as given or from the focal length and the pixel pitch."""
    short = ("focal_length", "pixel_pitch", "principal_point")
    given = [name for name in short if getattr(entry, name) is not None]
    if entry.camera_matrix is not None:
        if given:
            raise ValueError(f"{given[0]}: found beside camera_matrix, expected one of the two")
        return entry.camera_matrix
    for name in short[:2]:
        if name not in given:
            raise ValueError(
                f"{name if given else 'camera_matrix'}: missing, expected camera_matrix, "
                "or focal_length and pixel_pitch"
            )
    size = cast("tuple[int, int]", entry.image_size)  # both were looked for above
    focal, pitch = cast("float", entry.focal_length), entry.pixel_pitch
    assert pitch is not None
    return matrix_of_lens(size, focal, pitch, entry.principal_point)


def _pose(entry: CameraEntry) -> tuple[Any, Any]:
    """Return ``R`` and ``t``, as given or from position, look_at and up."""
    groups = (("R", "t"), ("position", "look_at", "up"))
    given = [[name for name in names if getattr(entry, name) is not None] for names in groups]
    if given[0] and given[1]:
        raise ValueError(f"{given[1][0]}: found beside {given[0][0]}, expected one of the two")
    names = groups[1] if given[1] else groups[0]
    for name in names:
        if getattr(entry, name) is None:
            raise ValueError(f"{name}: missing, expected R and t, or position, look_at and up")
    if given[1]:
        return look_at(*(getattr(entry, name) for name in groups[1]))
    return entry.R, entry.t
