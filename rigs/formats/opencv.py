"""OpenCV's ``cv2.FileStorage`` files, YAML, XML and JSON, as its calibration programs write them.

Conventions are this package's: ``x_cam = R @ x_world + T``, pixel centres at integers. Known are

- one camera per file, as ``samples/cpp/tutorial_code/calib3d/camera_calibration`` writes it:
  ``image_width, image_height, camera_matrix, distortion_coefficients, fisheye_model``, here with
  its pose ``R, T`` (ROS writes the same keys, without poses);
- several in one: a list ``cameras`` of such entries with a ``name`` each, or a mapping of names;
- a folder of one-camera files, named by the files;
- lists of one length in one file, ``camera_matrix: [...], distortion_coefficients: [...], R, T``,
  under these names or their plurals (``cameraMatrices, distCoeffs, rvecs, tvecs``);
- numbered keys in one file, ``camera_matrix_0, camera_distortion_0, camera_pose_0`` (world to
  camera, 4 x 4), as ``ccalib``'s ``MultiCameraCalibration`` writes them without an image size;
- ``intrinsics.yml`` (``M1, D1, M2, D2``) and ``extrinsics.yml`` (``R, T``: second camera from
  first) of ``samples/cpp/stereo_calib``, either of them, or both in one; the cameras are
  ``left`` and ``right`` and the world is the left one's axes. They hold no image size.

OpenCV's files name no unit; those written here hold ``length_unit``. Written are lists of
``cameras`` for rigs, single entries for rigs of one, or folders.
https://docs.opencv.org/5.x/d4/da4/tutorial_file_input_output.html
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rigs.camera import Camera
from rigs.camera_protocol import LensCamera
from rigs.files.text import shortened, write_text
from rigs.files.units import UNKNOWN
from rigs.formats._file_storage import (
    LENS,
    MATRIX,
    PLURALS,
    SHIFT,
    SUFFIXES,
    TURN,
    entries_of,
    first,
    has_cameras,
    is_fisheye,
    is_storage,
    matrix,
    read_storage,
    size_of,
    storage_files,
    turn,
    vector,
)
from rigs.formats._lens import from_vector, refuse_skew, refuse_tables
from rigs.formats._values import (
    errors_of,
    errors_of_file,
    read_head,
    required_size,
    rotation_of_motion,
    usable_name,
)
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_POSES = (*TURN, "pose")
_STEREO = (("M1", "M2"), ("K1", "K2"), ("cameraMatrix1", "cameraMatrix2"))
_STEREO_LENS = (("D1", "D2"), ("distCoeffs1", "distCoeffs2"))


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file, or one in a folder, holds the keys of OpenCV's programs."""
    if path.is_dir():
        return any(looks_like(file, read_head(file)) for file in storage_files(path))
    known = (*_STEREO, MATRIX[:2], PLURALS[MATRIX], ("camera_matrix_0",))
    keys = "|".join(key for keys in known for key in keys)
    has_camera = re.search(rf'["\s{{,<](?:{keys})(?:"?\s*:|[\s>])', head)
    is_opencv = is_storage(head) or head.startswith("%YAML")
    return bool(
        path.suffix in SUFFIXES
        and (path.suffix != ".xml" or is_opencv)
        and not re.search(r"^format\s*:\s*emission", head, re.MULTILINE)
        and "camera_pose_matrix" not in head  # MC-Calib's
        and (has_camera or (is_opencv and re.search(r'["\s<]R(?:"?\s*:|[\s>])', head)))
    )


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a file of cameras, a folder of them, or a stereo pair's two files."""
    if path.is_dir():
        entries: dict[str, Any] = {}
        unit = UNKNOWN
        for file in storage_files(path):
            data = read_storage(file)
            if any(pair[0] in data for pair in _STEREO):
                with errors_of_file(file):
                    return load(file, image_size)
            if not has_cameras(data):
                continue
            with errors_of_file(file):
                for given, entry in entries_of(data, file.stem).items():
                    name = usable_name(given, file)
                    if entries.setdefault(name, entry) is not entry:
                        raise ValueError(f"camera {name}: found in another file too, expected one")
            unit = data.get("length_unit", unit)
        if not entries:
            raise ValueError(f"{path}: found no camera_matrix in its files, expected OpenCV's")
    else:
        data = read_storage(path)
        unit = data.get("length_unit", UNKNOWN)
        with errors_of_file(path):
            is_pair = any(key in data for key in (*(pair[0] for pair in _STEREO), "R1", "P1"))
            if is_pair and "cameras" not in data and first(data, MATRIX) is None:
                return _stereo(path, data, image_size)
            found = entries_of(data, path.stem)
            entries = {usable_name(name, path): entry for name, entry in found.items()}
            if len(entries) < len(found):
                raise ValueError(f"camera: found names alike without slashes: {', '.join(found)}")
    if not isinstance(unit, str):
        raise ValueError(f"length_unit: found {shortened(unit)}, expected text")
    posed = {name for name, entry in entries.items() if first(entry, _POSES) is not None}
    if posed and len(posed) < len(entries):
        lost = next(name for name in entries if name not in posed)
        raise ValueError(f"camera {lost}: R: missing, expected it as other cameras have one")
    world = f"as in {path.name}" if posed else "none: every camera stands at the origin"
    cameras = [_camera(name, entry, image_size) for name, entry in entries.items()]
    if not posed:
        logger.warning("%s: no poses (R, T) in it: all cameras stand at the origin", path)
    return Rig(tuple(cameras), unit, world)


def save(rig: Rig, path: Path) -> None:
    """Write a rig as ``cv2.FileStorage`` does: JSON, XML or YAML, by the ending of ``path``.

    A path with another ending is a folder, of one YAML file per camera.
    """
    cameras = refuse_tables(rig, "OpenCV")
    for camera in cameras:
        refuse_skew(camera, "OpenCV")
    if path.suffix in SUFFIXES:
        write_text(path, _text(rig, path))
        return
    own = {f"{camera.name}.yml" for camera in cameras}
    for file in storage_files(path) if path.is_dir() else ():
        if file.name not in own and has_cameras(read_storage(file)):
            raise ValueError(f"{file}: found cameras of another rig, expected a folder without")
    for index, camera in enumerate(cameras):
        file = path / f"{camera.name}.yml"
        write_text(file, _text(rig[index : index + 1], file))


def _text(rig: Rig, path: Path) -> str:
    """Return what ``cv2.FileStorage`` writes into a file of that name."""
    import cv2

    kinds = {".json": cv2.FILE_STORAGE_FORMAT_JSON, ".xml": cv2.FILE_STORAGE_FORMAT_XML}
    kind = kinds.get(path.suffix, cv2.FILE_STORAGE_FORMAT_YAML)
    cameras = refuse_tables(rig, "OpenCV")
    storage = cv2.FileStorage(path.name, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kind)
    try:
        storage.write("length_unit", rig.length_unit)
        if len(cameras) == 1:
            _write_camera(storage, cameras[0])
        else:
            storage.startWriteStruct("cameras", cv2.FILE_NODE_SEQ)
            for camera in cameras:
                storage.startWriteStruct("", cv2.FILE_NODE_MAP)
                _write_camera(storage, camera)
                storage.endWriteStruct()
            storage.endWriteStruct()
    except cv2.error as error:
        raise ValueError(f"OpenCV: {error.err}") from None
    return storage.releaseAndGetString()


def _camera(name: str, entry: Mapping[str, Any], image_size: tuple[int, int] | None) -> Camera:
    """Return the camera of an entry."""
    with errors_of(f"camera {name}"):
        K = matrix(entry, MATRIX, (3, 3))
        distortion = from_vector(vector(entry, LENS), is_fisheye(entry), LENS[0])
        size = size_of(entry) or required_size(image_size, "these OpenCV")
        if "xi" in entry:
            raise ValueError("xi: found it, as of an omnidirectional lens, expected a pinhole")
        R, t = np.eye(3), np.zeros(3)
        if first(entry, TURN) is not None:
            R, t = turn(entry), vector(entry, SHIFT, 3)
        elif "pose" in entry:
            motion = matrix(entry, ("pose",), (4, 4))
            R, t = rotation_of_motion(motion, "camera_pose"), motion[:3, 3]
        status = "calibrated" if first(entry, _POSES) is not None else "nominal"
    return Camera(name, size, K, distortion, R, t, status=status)


def _stereo(path: Path, data: dict[str, Any], image_size: tuple[int, int] | None) -> Rig:
    """Return the pair of cameras in stereo_calib's two files; ``path`` is one of them."""
    merged = dict(data)
    if not {"R", "T"} <= data.keys() or not any(pair[0] in data for pair in _STEREO):
        other = "intrinsics" if "R" in data else "extrinsics"
        partner = path.with_name(re.sub("(?i)in?trinsics?|extrinsics?", other, path.stem, count=1))
        partner = partner.with_suffix(path.suffix)
        if partner == path or not partner.is_file():
            field = "M1" if other == "intrinsics" else "R"
            raise ValueError(f"{field}: missing, expected it here or in {other}{path.suffix}")
        merged = {**read_storage(partner), **data}
    size = size_of(merged) or required_size(image_size, "stereo_calib's")
    unit = merged.get("length_unit", UNKNOWN)
    pair = next(keys for keys in _STEREO if keys[0] in merged)
    lenses = next((keys for keys in _STEREO_LENS if keys[0] in merged), _STEREO_LENS[0])
    cameras = []
    for index, name in enumerate(("left", "right")):
        with errors_of(f"camera {name}"):
            K = matrix(merged, (pair[index],), (3, 3))
            lens = vector(merged, (lenses[index],))
            distortion = from_vector(lens, is_fisheye(merged), lenses[index])
            R = turn(merged) if index else np.eye(3)
            t = vector(merged, SHIFT, 3) if index else np.zeros(3)
        cameras.append(Camera(name, size, K, distortion, R, t, status="calibrated"))
    return Rig(tuple(cameras), unit, "the left camera's axes")


def _write_camera(storage: Any, camera: LensCamera) -> None:
    """Write the entries of a camera into the open structure of a ``cv2.FileStorage``."""
    coefficients = camera.distortion.coefficients or (0.0,) * 5
    storage.write("name", camera.name)
    storage.write("image_width", camera.image_size[0])
    storage.write("image_height", camera.image_size[1])
    storage.write("fisheye_model", int(camera.distortion.model == "fisheye"))
    storage.write("camera_matrix", np.array(camera.camera_matrix))
    storage.write("distortion_coefficients", np.array([coefficients]))
    storage.write("R", np.array(camera.R))
    storage.write("T", np.array(camera.t).reshape(3, 1))
