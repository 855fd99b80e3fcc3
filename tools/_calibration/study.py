"""The study's measurements: rendered rigs with known truth, a real pair of cameras, time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _calibration.cases import CASES, TARGET, Case, pictures
from _calibration.peer import attempts
from _calibration.scenes import COMPLETE, arc_rig, held
from _calibration.truth import in_metres, of_complete_targets, true_ray_miss
from rigs import Rig, Volume
from rigs.calibrate import Calibration, Observations, calibrate, observe, parse_target

Row = dict[str, Any]
Say = Callable[[str], None]

STEREO_TARGET = "chessboard:9x6:1.0"


def rendered(
    seeds: Sequence[int],
    folder: Path,
    say: Say,
    cases: Sequence[Case] = CASES,
    workers: int = 2,
) -> dict[str, list[Row]]:
    """Return rows of ``rendered`` and of ``peer``: one a case and seed, one a setting of OpenCV's.

    Parameters
    ----------
    seeds : sequence of int
    folder : Path
        Of the pictures; what is there already is not rendered again.
    say : callable
        Called with a line at each step.
    cases : sequence of Case
    workers : int
        Threads.
    """
    rows: list[Row] = []
    peers: list[Row] = []
    for case in cases:
        for seed in seeds:
            say(f"{case.name}, seed {seed}: pictures")
            images = pictures(case, seed, folder, workers=workers)
            say(f"{case.name}, seed {seed}: calibration")
            row, observations = measured(case, seed, images)
            rows.append(row)
            if case.complete:
                say(f"{case.name}, seed {seed}: cv2.calibrateMultiview")
                peers += _peer(case, seed, in_metres(observations))
    return {"rendered": rows, "peer": peers}


def measured(
    case: Case, seed: int, images: Mapping[str, Mapping[str, Path]]
) -> tuple[Row, Observations]:
    """Return what detection and calibration make of a case's pictures, and the sightings used."""
    rig, target = case.rig(seed), parse_target(TARGET)
    started = time.perf_counter()
    observations = observe(images, target)
    detection = time.perf_counter() - started
    if case.complete:
        observations = of_complete_targets(observations)
    results = {}
    for unit, scale, sightings in (
        ("mm", 1.0, observations),
        ("m", 1e-3, in_metres(observations)),
    ):
        started = time.perf_counter()
        calibration = calibrate(
            sightings,
            world={camera.name: camera.position * scale for camera in rig},
            length_unit=unit,
            volume=_in(rig, scale),
        )
        seconds = time.perf_counter() - started
        results[unit] = (
            calibration,
            true_ray_miss(rig, calibration.rig, rig.volume) / scale,
            seconds,
        )
    (found, miss, seconds), (_, miss_in_metres, _) = results["mm"], results["m"]
    error = detection_error(case, seed, observations)
    quality = found.quality
    return {
        "case": case.name,
        "seed": seed,
        "images": sum(len(frames) for frames in images.values()),
        "images_used": int(np.isfinite(quality.image_rms).sum()),
        "points_used": int(found.used.sum()),
        "points_left_out": int((~found.used).sum()),
        "detection_error_px": float(np.sqrt((error[found.used] ** 2).sum(axis=1).mean())),
        "rms_px": float(np.sqrt((found.residuals[found.used] ** 2).sum(axis=1).mean())),
        "footprint": float(np.median(rig.footprint(rig.volume.center))),
        "true_ray_miss": miss,
        "true_ray_miss_from_metres": miss_in_metres,
        "predicted_ray_miss": quality.predicted_ray_miss,
        "cross_ray_miss": quality.cross_ray_miss,
        "cross_expected": quality.cross_expected,
        "seconds_to_detect": detection,
        "seconds_to_calibrate": seconds,
        "terms": list(found.terms),
        "verdict": found.verdict.split("\n")[0],
        "findings": list(found.findings),
    }, observations


def _in(rig: Rig, scale: float) -> Volume:
    """Return the rig's volume in another unit."""
    volume = rig.volume
    return replace(
        volume,
        spacing=tuple(scale * edge for edge in volume.spacing),
        center=tuple(scale * x for x in volume.center),
    )


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
    rig = case.rig(seed)
    return [
        {
            "case": case.name,
            "seed": seed,
            "setting": attempt.setting,
            "true_ray_miss": None
            if attempt.rig is None
            else 1e3 * true_ray_miss(rig, attempt.rig, rig.volume),
            "threw": attempt.words,
            "seconds": attempt.seconds,
        }
        for attempt in attempts(observations)
    ]


def stereo(folder: Path, say: Say) -> list[Row]:
    """Return one row on OpenCV's sample pairs of a chessboard; none where they are not there."""
    pairs = folder / "chessboard_stereo"
    if not pairs.is_dir():
        return []
    say("chessboard pairs")
    images = {
        side: {path.stem[-2:]: path for path in sorted((pairs / side).glob("*.jpg"))}
        for side in ("left", "right")
    }
    target = parse_target(STEREO_TARGET)
    observations = observe(images, target)
    found = calibrate(observations, length_unit="squares", target=target)
    alone = {
        side: calibrate(_one(observations, index), length_unit="squares", target=target)
        for index, side in enumerate(observations.cameras)
    }
    left, right = found.rig
    return [
        {
            "images": len(
                np.unique(np.stack([observations.camera, observations.frame]), axis=1).T
            ),
            "left_rms_px": _rms(alone["left"]),
            "right_rms_px": _rms(alone["right"]),
            "joint_rms_px": _rms(found),
            "points_left_out": int((~found.used).sum()),
            "baseline": float(np.linalg.norm(left.position - right.position)),
            "focal_lengths": [camera.camera_matrix[0, 0] for camera in found.rig],
            "predicted_ray_miss": found.quality.predicted_ray_miss,
            "terms": list(found.terms),
        }
    ]


def _one(observations: Observations, camera: int) -> Observations:
    """Return what one camera saw, without the others."""
    own = observations.where(observations.camera == camera)
    return replace(
        own,
        cameras=(own.cameras[camera],),
        image_sizes=(own.image_sizes[camera],),
        camera=np.zeros(len(own), np.int64),
    )


def _rms(calibration: Calibration) -> float:
    """Return the RMS length of the residuals used, as OpenCV counts it."""
    return float(np.sqrt((calibration.residuals[calibration.used] ** 2).sum(axis=1).mean()))


def timing(say: Say, cameras: int = 12, frames: int = 60) -> list[Row]:
    """Return how long calibration takes when every camera sees the target in every frame."""
    say(f"{cameras} cameras x {frames} frames")
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
