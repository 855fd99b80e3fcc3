"""Rendered boards: how near to known rigs calibration comes, and what it says of itself.

True ray-miss: points of the volume are projected with the true cameras, the pixels cast back with
those found; the RMS distance of the rays from their best common point, in mm. Predicted: from the
covariance, knowing nothing of the truth. `cross`: between the rigs of every other frame and of the
rest, and what the covariances let expect. Focal lengths, principal points, distortion and mounts
vary from camera to camera. `against_opencv` is cv2.calibrateMultiview on the images that show the
whole board, in metres, at the best of six settings; `timing` has noise of 0.05 px, detection not
included.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rigs import Camera, Distortion, Rig, Volume, box_points, ray_miss
from rigs.calibrate import Observations, calibrate
from rigs.calibrate.detect import observe
from rigs.calibrate.targets import parse_target
from studies.calibration.scenes import CASES, COMPLETE, TARGET, TINY, Case, arc_rig, held, pictures
from studies.common.study import Request, Tables


def true_ray_miss(true: Rig, estimated: Rig, volume: Volume, points_per_side: int = 5) -> float:
    """Return the RMS distance of estimated rays from their best common point, in their unit.

    Points of the volume, its faces included, are projected with the true cameras, and the pixels
    cast back with the estimated ones of the same names.
    """
    corners = volume.corners()
    points = box_points(corners[0], corners[-1], points_per_side)
    return ray_miss(true, estimated, points)


def in_metres(observations: Observations) -> Observations:
    """Return observations of a target in millimetres with its points in metres."""
    return replace(observations, target_points=observations.target_points / 1000)


def of_complete_targets(observations: Observations) -> Observations:
    """Return the observations in images that show every point of the target."""
    complete = observations.counts() == len(observations.target_points)  # (cameras, frames)
    return observations.where(complete[observations.camera, observations.frame])


Row = dict[str, Any]


def run(request: Request) -> Tables:
    """Measure rendered rigs, OpenCV on the same, and time."""
    full = request.size == "full"
    cases, seed = CASES if full else TINY, request.seed + 1
    tables: Tables = {"rendered": [], "peer": []}
    with tempfile.TemporaryDirectory() as name:
        for case in request.each(cases, lambda case: case.words):
            images = pictures(case, seed, Path(name))
            row, observations = measured(case, seed, images)
            tables["rendered"].append(row)
            if case.complete:
                tables["peer"] += _peer(case, seed, in_metres(observations))
    tables["against_opencv"] = _best_of_opencv(tables)
    tables["timing"] = timing(*((12, 60) if full else (3, 6)))
    return tables


def measured(
    case: Case, seed: int, images: Mapping[str, Mapping[str, Path]]
) -> tuple[Row, Observations]:
    """Return what detection and calibration make of a case's pictures, and the sightings used."""
    rig, target = case.rig(seed), parse_target(TARGET)
    observations = observe(images, target)
    if case.complete:
        observations = of_complete_targets(observations)
    world = {camera.name: camera.position for camera in rig}
    found = calibrate(observations, world=world, length_unit="mm", volume=rig.volume)
    miss = true_ray_miss(rig, found.rig, rig.volume)
    error = detection_error(case, seed, observations)
    quality = found.quality
    return {
        "case": case.words,
        "seed": seed,
        "images": sum(len(frames) for frames in images.values()),
        "images_used": int(np.isfinite(quality.image_rms).sum()),
        "points_used": int(found.used.sum()),
        "detection_error_px": float(np.sqrt((error[found.used] ** 2).sum(axis=1).mean())),
        "rms_px": float(np.sqrt((found.residuals[found.used] ** 2).sum(axis=1).mean())),
        "footprint": float(np.median(rig.footprint(rig.volume.center))),
        "true_ray_miss": miss,
        "predicted_ray_miss": quality.predicted_ray_miss,
        "cross_ray_miss": quality.cross_ray_miss,
        "cross_expected": quality.cross_expected,
    }, observations


def detection_error(case: Case, seed: int, observations: Observations) -> NDArray[np.float64]:
    """Return how far from the truth each point was detected, ``(sightings, 2)`` pixels."""
    rig, target = case.rig(seed), parse_target(TARGET)
    poses = held(case.poses, target.points.mean(axis=0), np.random.default_rng([seed, 3]))
    error = np.zeros((len(observations), 2))
    pose = np.array([int(name.split("_")[1]) for name in observations.frames], np.int64)
    for index, name in enumerate(observations.cameras):
        own = np.flatnonzero(observations.camera == index)
        R, t = (part[pose[observations.frame[own]]] for part in poses)
        points = observations.target_points[observations.point[own]]
        uv, _, _ = rig[name].project(np.einsum("nij,nj->ni", R, points) + t)
        error[own] = observations.uv[own] - uv
    return error


def _peer(case: Case, seed: int, observations: Observations) -> list[Row]:
    rig, rows = case.rig(seed), []
    for setting, found in attempts(observations):
        miss = found and 1e3 * true_ray_miss(rig, found, rig.volume)
        rows.append({"case": case.words, "seed": seed, "setting": setting, "true_ray_miss": miss})
    return rows


def _best_of_opencv(tables: Tables) -> list[Row]:
    """Return OpenCV's best setting of each complete case, beside ours; the truth chooses it."""
    rows = []
    for ours in tables["rendered"]:
        key = ours["case"], ours["seed"]
        done = [
            peer for peer in tables["peer"]
            if (peer["case"], peer["seed"]) == key and peer["true_ray_miss"] is not None
        ]  # fmt: skip
        if done:
            best = min(done, key=lambda peer: peer["true_ray_miss"])
            found = {"opencv": best["true_ray_miss"], "setting": best["setting"]}
            rows.append({"case": key[0], "seed": key[1], **found, "ours": ours["true_ray_miss"]})
    return rows


def timing(cameras: int = 12, frames: int = 60) -> list[Row]:
    """Return how long calibration takes when every camera sees the target in every frame."""
    rig, target = arc_rig(0, cameras), parse_target(TARGET)
    generator = np.random.default_rng(0)
    poses = held(replace(COMPLETE, count=frames), target.points.mean(axis=0), generator)
    parts, pixels = [], []
    for frame, (R, t) in enumerate(zip(*poses, strict=True)):
        for index, camera in enumerate(rig):
            uv, _, _ = camera.project(target.points @ R.T + t)
            seen = np.flatnonzero(camera.inside(uv))
            parts.append(np.column_stack([np.full((len(seen), 2), (index, frame)), seen]))
            pixels.append(uv[seen] + 0.05 * generator.standard_normal((len(seen), 2)))
    places = np.concatenate(parts)
    observations = Observations(
        target.points,
        rig.names,
        tuple(camera.image_size for camera in rig),
        tuple(f"pose_{frame:03d}" for frame in range(frames)),
        *places.T,
        np.concatenate(pixels),
    )
    started, worked = time.perf_counter(), time.process_time()
    calibration = calibrate(observations)
    return [
        {
            "cameras": cameras,
            "frames": frames,
            "points": len(observations),
            "seconds": time.perf_counter() - started,
            "core_seconds": time.process_time() - worked,
            "true_ray_miss": true_ray_miss(rig, calibration.rig, rig.volume),
            "predicted_ray_miss": calibration.quality.predicted_ray_miss,
        }
    ]


def attempts(observations: Observations) -> Iterator[tuple[str, Rig | None]]:
    """Yield what each setting makes of observations of complete targets; None where it throws.

    It throws on targets in millimetres, so these are to be in metres. The intrinsics are found
    by its own first step, with five, four or two coefficients of distortion, or taken from
    ``cv2.calibrateCamera`` of each camera alone.
    """
    lenses = {
        "k1 k2 p1 p2 k3": 0,
        "k1 k2 p1 p2": cv2.CALIB_FIX_K3,
        "k1 k2": cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    }
    for words, flags in lenses.items():
        for guess in (False, True):
            setting = words + (", lenses of calibrateCamera" if guess else "")
            try:
                yield setting, _multiview(observations, flags, guess)
            except cv2.error:
                yield setting, None


def _multiview(observations: Observations, flags: int, guess: bool) -> Rig:
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
        "m",
    )
