"""COLMAP's binary files as the lines of their text form, and its rigs of sensors.

``cameras.bin, images.bin, rigs.bin``: little-endian, a count (uint64), then the entries, in the
order of the text files. The image points of ``images.bin`` are skipped. Source:
``scripts/python/read_write_model.py`` and ``src/colmap/scene/reconstruction_io_binary.cc`` at
https://github.com/colmap/colmap.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import shortened
from rigs.formats._colmap_lenses import MODELS
from rigs.formats._values import as_count, errors_of, numbers_of_line
from rigs.geometry.rotation import matrix_of_quaternion
from rigs.rig import Rig

POSE = ["QW", "QX", "QY", "QZ", "TX", "TY", "TZ"]
_NUMBERS = {number: name for name, (number, _, _) in MODELS.items()}
_POINT = struct.calcsize("<2dQ")  # an image point, and the number of its 3-D point
_KINDS = {0: "CAMERA", 1: "IMU"}  # of sensors; other numbers are written as they are


def text_of(file: Path) -> str:
    """Return the lines that a text model has in the place of a binary file."""
    entries = _ENTRIES[file.stem]
    with file.open("rb") as stream:
        (count,) = _unpacked(stream, "Q")
        lines: list[str] = []
        for _ in range(count):
            lines += entries(stream)
        if stream.read(1):
            raise ValueError(f"found more bytes after {count} entries, expected the file's end")
    return "\n".join([*lines, ""])


def _unpacked(stream: BinaryIO, layout: str) -> tuple:
    """Return the next values of a stream."""
    size = struct.calcsize(f"<{layout}")
    data = stream.read(size)
    if len(data) < size:
        raise ValueError(f"found the file's end at byte {stream.tell()}, expected another entry")
    return struct.unpack(f"<{layout}", data)


def _camera(stream: BinaryIO) -> Iterator[str]:
    """Yield the line of a camera."""
    key, number, width, height = _unpacked(stream, "IiQQ")
    if number not in _NUMBERS:
        raise ValueError(f"camera {key}: MODEL: found {number}, expected 0 to {max(_NUMBERS)}")
    name = _NUMBERS[number]
    values = _unpacked(stream, f"{len(MODELS[name][2].split())}d")
    yield " ".join([str(key), name, str(width), str(height), *map(repr, values)])


def _image(stream: BinaryIO) -> Iterator[str]:
    """Yield the line of an image, and an empty one for its points."""
    key, *pose, camera = _unpacked(stream, "I7dI")
    name = bytearray()
    while (byte := stream.read(1)) not in (b"\0", b""):
        name += byte
    (points,) = _unpacked(stream, "Q")
    here = stream.tell()
    if points * _POINT > stream.seek(0, 2) - here:
        raise ValueError(f"image {key}: found the file's end before its {points} points")
    stream.seek(here + points * _POINT)
    try:
        text = name.decode("utf-8")
    except UnicodeDecodeError:
        raise ValueError(f"image {key}: NAME: found bytes that are not UTF-8") from None
    if text.splitlines() != [text]:
        raise ValueError(f"image {key}: NAME: found {text[:60]!r}, expected one line")
    yield " ".join([str(key), *map(repr, pose), str(camera), text])
    yield ""


def _rig(stream: BinaryIO) -> Iterator[str]:
    """Yield the line of a rig."""
    key, sensors = _unpacked(stream, "II")
    words = [str(key), str(sensors)]
    for index in range(sensors):
        kind, number = _unpacked(stream, "iI")
        words += [_KINDS.get(kind, str(kind)), str(number)]
        if index:  # the first is the reference, without a pose
            (has_pose,) = _unpacked(stream, "B")
            words.append(str(int(has_pose != 0)))
            if has_pose:
                words += map(repr, _unpacked(stream, "7d"))
    yield " ".join(words)


_ENTRIES: dict[str, Callable[[BinaryIO], Iterator[str]]] = {
    "cameras": _camera,
    "images": _image,
    "rigs": _rig,
}


def read_sensors(lines: list[str]) -> dict[int, tuple[NDArray, NDArray]]:
    """Return the pose of each camera relative to its rig's reference sensor.

    A line is ``RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID`` and for each other sensor
    ``SENSOR_TYPE SENSOR_ID HASPOSE [QW QX QY QZ TX TY TZ]``, sensor from rig.
    """
    rows = [line.split() for line in lines if line.strip()]
    if len(rows) != 1:
        raise ValueError(f"found {len(rows)} rigs, expected one, as they have no common axes")
    words = rows[0]
    with errors_of(f"rig {shortened(words[0])}"):
        if len(words) < 4 or words[2] != "CAMERA":
            raise ValueError(
                f"found {shortened(' '.join(words))}, "
                "expected RIG_ID NUM_SENSORS CAMERA REF_SENSOR_ID SENSORS"
            )
        count, reference = as_count(words[1], "NUM_SENSORS"), as_count(words[3], "REF_SENSOR_ID")
        poses = {reference: (np.eye(3), np.zeros(3))}
        words = words[4:]
        while words:
            if len(words) < 3 or words[2] not in ("0", "1"):
                raise ValueError(
                    f"SENSORS: found {shortened(' '.join(words))}, "
                    "expected SENSOR_TYPE SENSOR_ID HASPOSE"
                )
            kind, number, has_pose = words[0], as_count(words[1], "SENSOR_ID"), words[2] == "1"
            if kind == "CAMERA":
                with errors_of(f"camera {number}"):
                    if not has_pose:
                        raise ValueError("HASPOSE: found 0, expected a pose")
                    if number in poses:
                        raise ValueError("SENSOR_ID: found twice, expected once")
                    pose = numbers_of_line(words[3:10], POSE)
                    R = matrix_of_quaternion(pose[:4], "QW, QX, QY, QZ")
                poses[number] = (R, np.array(pose[4:]))
            words = words[10 if has_pose else 3 :]
        if count < len(poses):
            raise ValueError(f"NUM_SENSORS: found {count}, expected {len(poses)}")
    return poses


def has_several_sensors(lines: Iterable[str]) -> bool:
    """Return whether a rig has sensors beside its reference; a broken line counts as one."""
    return any(line.split()[1:2] != ["1"] for line in lines if line.strip())


def rig_texts(rig: Rig, pose_text: Callable[[NDArray, NDArray], str]) -> dict[str, str]:
    """Return ``rigs.txt`` and ``frames.txt`` of one rig, the first camera its reference."""
    first = rig[0]
    sensors = []
    for number, camera in enumerate(rig.cameras[1:], 2):
        turn = camera.R @ first.R.T
        sensors.append(f"CAMERA {number} 1 {pose_text(turn, camera.t - turn @ first.t)}")
    data = " ".join(f"CAMERA {number} {number}" for number in range(1, len(rig) + 1))
    return {
        "rigs.txt": "# RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as "
        "(SENSOR_TYPE, SENSOR_ID, HASPOSE, [QW, QX, QY, QZ, TX, TY, TZ])\n"
        f"{' '.join([f'1 {len(rig)} CAMERA 1', *sensors])}\n",
        "frames.txt": "# FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], "
        "NUM_DATA_IDS, DATA_IDS[] as (SENSOR_TYPE, SENSOR_ID, DATA_ID)\n"
        f"1 1 {pose_text(first.R, first.t)} {len(rig)} {data}\n",
    }
