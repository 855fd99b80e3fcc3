"""OpenCV's own calibration of many cameras, at its best."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rigs import Camera, Distortion, Rig
from rigs.calibrate import Observations


@dataclass(frozen=True)
class Attempt:
    """What one setting of ``cv2.calibrateMultiview`` gave."""

    setting: str
    rig: Rig | None  # None where it threw
    words: str  # what it threw
    seconds: float


def attempts(observations: Observations, length_unit: str = "m") -> Iterator[Attempt]:
    """Yield what each setting makes of observations of complete targets.

    It throws on targets in millimetres, so these are to be in metres. The intrinsics are found
    by its own first step, with five, four or two coefficients of distortion, or taken from
    ``cv2.calibrateCamera`` of each camera alone.
    """
    import cv2

    lenses = {
        "k1 k2 p1 p2 k3": 0,
        "k1 k2 p1 p2": cv2.CALIB_FIX_K3,
        "k1 k2": cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    }
    for words, flags in lenses.items():
        for guess in (False, True):
            started = time.perf_counter()
            setting = words + (", lenses of calibrateCamera" if guess else "")
            rig, said = None, ""
            try:
                rig = _multiview(observations, flags, guess, length_unit)
            except cv2.error as error:
                said = str(error.err)
            yield Attempt(setting, rig, said, time.perf_counter() - started)


def _multiview(observations: Observations, flags: int, guess: bool, length_unit: str) -> Rig:
    import cv2

    points = np.float32(observations.target_points)
    cameras, frames = len(observations.cameras), len(observations.frames)
    mask = (observations.counts() == len(points)).astype(np.uint8)  # (cameras, frames)
    uv = np.full((cameras, frames, len(points), 2), -1, np.float32)
    uv[observations.camera, observations.frame, observations.point] = observations.uv
    sizes = [tuple(size) for size in observations.image_sizes]
    per_camera = np.full((cameras, 1), flags, np.int32)
    settings = {"flagsForIntrinsics": per_camera}
    Ks = distortions = None
    if guess:
        Ks, distortions = [], []
        for camera in range(cameras):
            seen = np.flatnonzero(mask[camera])
            _, K, coefficients, _, _ = cv2.calibrateCamera(
                [points] * len(seen), list(uv[camera, seen]), sizes[camera], None, None,
                flags=flags,
            )  # fmt: skip
            Ks.append(K)
            distortions.append(coefficients)
        settings["flags"] = cv2.CALIB_USE_INTRINSIC_GUESS
    _, Ks, distortions, Rs, Ts = cv2.calibrateMultiview(
        [points] * frames,
        [list(uv[camera]) for camera in range(cameras)],
        sizes,
        mask,
        np.full((cameras, 1), cv2.CALIB_MODEL_PINHOLE, np.uint8),
        Ks,
        distortions,
        None,
        None,
        **settings,
    )[:5]
    return Rig(
        tuple(
            Camera(
                name,
                sizes[index],
                Ks[index],
                Distortion("brown", np.ravel(distortions[index])[:5]),
                cv2.Rodrigues(np.asarray(Rs[index]))[0] if np.size(Rs[index]) == 3 else Rs[index],
                np.ravel(Ts[index]),
            )
            for index, name in enumerate(observations.cameras)
        ),
        length_unit,
    )
