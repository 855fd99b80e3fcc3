"""COLMAP's ``rigs.txt`` and ``frames.txt``: sensors that move as one."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import shortened
from rigs.formats._values import as_count, errors_of, numbers_of_line
from rigs.geometry.rotation import matrix_of_quaternion
from rigs.rig import Rig

_POSE = ["QW", "QX", "QY", "QZ", "TX", "TY", "TZ"]


def read_sensors(lines: list[str]) -> dict[int, tuple[NDArray, NDArray]]:
    """Return the pose of each camera relative to its rig's reference sensor.

    A line is ``RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID`` and for each other sensor
    ``SENSOR_TYPE SENSOR_ID HAS_POSE [QW QX QY QZ TX TY TZ]``, sensor from rig.
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
                    "expected SENSOR_TYPE SENSOR_ID HAS_POSE"
                )
            kind, number, has_pose = words[0], as_count(words[1], "SENSOR_ID"), words[2] == "1"
            if kind == "CAMERA":
                with errors_of(f"camera {number}"):
                    if not has_pose:
                        raise ValueError("HAS_POSE: found 0, expected a pose")
                    if number in poses:
                        raise ValueError("SENSOR_ID: found twice, expected once")
                    pose = numbers_of_line(words[3:10], _POSE)
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
    if not len(rig):
        raise ValueError("cameras: found none, expected at least one")
    first = rig[0]
    sensors = []
    for number, camera in enumerate(rig.cameras[1:], 2):
        turn = camera.R @ first.R.T
        sensors.append(f"CAMERA {number} 1 {pose_text(turn, camera.t - turn @ first.t)}")
    data = " ".join(f"CAMERA {number} {number}" for number in range(1, len(rig) + 1))
    return {
        "rigs.txt": "# RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as "
        "(SENSOR_TYPE, SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])\n"
        f"{' '.join([f'1 {len(rig)} CAMERA 1', *sensors])}\n",
        "frames.txt": "# FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], "
        "NUM_DATA_IDS, DATA_IDS[] as (SENSOR_TYPE, SENSOR_ID, DATA_ID)\n"
        f"1 1 {pose_text(first.R, first.t)} {len(rig)} {data}\n",
    }
