"""OpenCV's own calibration: many cameras at its best, and two."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs import Camera, Distortion, Rig
from rigs.calibrate import Observations


@dataclass(frozen=True)
class Attempt:
    """What one setting of ``cv2.calibrateMultiview`` gave.

    Attributes
    ----------
    setting : str
    rig : Rig or None
        None where it threw.
    words : str
        What it threw.
    seconds : float
    """

    setting: str
    rig: Rig | None
    words: str
    seconds: float


def attempts(observations: Observations, length_unit: str = "m") -> Iterator[Attempt]:
    """Yield what each setting makes of sightings of complete targets.

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


def stereo_pair(observations: Observations) -> dict[str, float]:
    """Return RMS and baseline of ``cv2.stereoCalibrate``, lenses adjusted too.

    Both cameras see every point of the target in every frame.
    """
    import cv2

    points = [np.float32(observations.target_points)] * len(observations.frames)
    sizes = observations.image_sizes
    uv = np.zeros((2, len(points), len(points[0]), 2), np.float32)
    uv[observations.camera, observations.frame, observations.point] = observations.uv
    alone = [cv2.calibrateCamera(points, list(uv[k]), sizes[k], None, None) for k in range(2)]
    joint = cv2.stereoCalibrate(
        points, list(uv[0]), list(uv[1]), *alone[0][1:3], *alone[1][1:3], sizes[0],
        flags=cv2.CALIB_USE_INTRINSIC_GUESS, criteria=(3, 300, 1e-10),
    )  # fmt: skip
    return {
        "left_rms_px": float(alone[0][0]),
        "right_rms_px": float(alone[1][0]),
        "joint_rms_px": float(joint[0]),
        "baseline": float(np.linalg.norm(joint[6])),
    }


def refined(
    observations: Observations, images: Mapping[str, Mapping[str, Path]], window: int
) -> NDArray[np.float64]:
    """Return where OpenCV's search and ``cv2.cornerSubPix`` have a chessboard's corners.

    Parameters
    ----------
    observations : Observations
        Of all the board's corners, which say in what order OpenCV's are.
    images : mapping
        ``images[camera][frame]`` is a file.
    window : int
        Half a side of the window, in pixels.

    Returns
    -------
    uv : (sightings, 2) float64
    """
    import cv2

    columns = int(np.ptp(observations.target_points[:, 0])) + 1
    uv = np.array(observations.uv)
    for camera, name in enumerate(observations.cameras):
        for frame, moment in enumerate(observations.frames):
            own = (observations.camera == camera) & (observations.frame == frame)
            image = cv2.imread(str(images[name][moment]), cv2.IMREAD_GRAYSCALE)
            size = (columns, len(observations.target_points) // columns)
            _, corners = cv2.findChessboardCorners(image, size)
            corners = cv2.cornerSubPix(
                image, corners, (window, window), (-1, -1), (3, 30, 1e-3)
            ).reshape(-1, 2)
            apart = [np.linalg.norm(order - uv[own], axis=1).sum()
                     for order in (corners, corners[::-1])]  # fmt: skip
            uv[own] = corners if apart[0] < apart[1] else corners[::-1]
    return uv
