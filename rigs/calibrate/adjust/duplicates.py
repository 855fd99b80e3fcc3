"""Repeated images: they add no information and must not count twice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.observations import Observations


def without_repeats(
    observations: Observations,
) -> tuple[NDArray[np.bool_], tuple[str, ...], tuple[str, ...]]:
    """Return which observations to keep, and lines on frozen cameras and on repeats.

    An image is a repeat where all of its observations equal those of an earlier frame of the same
    camera, to the last digit: noise never repeats itself.

    Returns
    -------
    keep : (observations,) bool
    frozen : tuple of str
        On cameras that repeat an image while others do not.
    repeats : tuple of str
        On frames that are repeated by every camera.
    """
    keep = np.ones(len(observations), bool)
    first: dict[tuple[int, bytes], int] = {}
    repeats: dict[tuple[int, int], list[int]] = {}
    order = np.lexsort((observations.point, observations.camera, observations.frame))
    image = observations.frame[order] * len(observations.cameras) + observations.camera[order]
    for rows in np.split(order, np.flatnonzero(np.diff(image)) + 1):
        if not len(rows):
            continue
        camera, frame = int(observations.camera[rows[0]]), int(observations.frame[rows[0]])
        content = observations.point[rows].tobytes() + observations.uv[rows].tobytes()
        earlier = first.setdefault((camera, content), frame)
        if earlier != frame:
            keep[rows] = False
            repeats.setdefault((earlier, frame), []).append(camera)
    counts = observations.counts()
    frozen, notes = [], []
    for (earlier, frame), cameras in sorted(repeats.items()):
        first_name, name = observations.frames[earlier], observations.frames[frame]
        if len(cameras) == np.count_nonzero(counts[:, frame]):
            notes.append(f"frame {name}: the same as {first_name} in every camera, counted once")
        else:
            named = ", ".join(observations.cameras[camera] for camera in cameras)
            frozen.append(
                f"camera {named}: frame {name} is the same image as {first_name} while other "
                "cameras have new ones; it was left out. Check that the cameras are synchronised"
            )
    return keep, tuple(frozen), tuple(notes)
