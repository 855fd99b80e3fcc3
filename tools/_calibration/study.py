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
from _calibration.peer import attempts, refined, stereo_pair
from _calibration.scenes import COMPLETE, arc_rig, held
from _calibration.truth import in_metres, of_complete_targets, true_ray_miss
from rigs import Rig, Volume
from rigs.calibrate import Calibration, Observations, calibrate
from rigs.calibrate.detect import observe
from rigs.calibrate.targets import parse_target

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
            row, observations = measured(case, seed, images, folder / f"{case.name}_{seed}.npz")
            rows.append(row)
            if case.complete:
                say(f"{case.name}, seed {seed}: cv2.calibrateMultiview")
                peers += _peer(case, seed, in_metres(observations))
    return {"rendered": rows, "peer": peers}


def measured(
    case: Case, seed: int, images: Mapping[str, Mapping[str, Path]], cache: Path
) -> tuple[Row, Observations]:
    """Return what detection and calibration make of a case's pictures, and the sightings used."""
    rig, target = case.rig(seed), parse_target(TARGET)
    observations = observe(images, target, cache=cache)
    if case.complete:
        observations = of_complete_targets(observations)
    results = {}
    for unit, scale, sightings in (
        ("mm", 1.0, observations),
        ("m", 1e-3, in_metres(observations)),
    ):
        calibration = calibrate(
            sightings,
            world={camera.name: camera.position * scale for camera in rig},
            length_unit=unit,
            volume=_in(rig, scale),
        )
        results[unit] = (calibration, true_ray_miss(rig, calibration.rig, rig.volume) / scale)
    (found, miss), (_, miss_in_metres) = results["mm"], results["m"]
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
    """Return rows on OpenCV's sample pairs of a chessboard; none where they are not there.

    The first is this project's; the others are OpenCV's own adjustment of both cameras, from
    these corners and from those of ``cv2.cornerSubPix`` in windows of two sizes.
    """
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
    alone = [
        calibrate(_one(observations, index), length_unit="squares", target=target)
        for index in range(2)
    ]
    left, right = found.rig
    rows: list[Row] = [
        {
            "corners": "this project's",
            "solver": "this project's",
            "images": int((observations.counts() > 0).sum()),
            "left_rms_px": _rms(alone[0]),
            "right_rms_px": _rms(alone[1]),
            "joint_rms_px": _rms(found),
            "points_left_out": sum(int((~each.used).sum()) for each in (found, *alone)),
            "baseline": float(np.linalg.norm(left.position - right.position)),
            "farthest_px": None,
            "terms": list(found.terms),
        }
    ]
    for words, uv in (
        ("this project's", observations.uv),
        *((f"cornerSubPix, {n} px", refined(observations, images, n)) for n in (11, 5)),
    ):
        apart = np.linalg.norm(uv - observations.uv, axis=1)
        rows.append(
            {
                "corners": words,
                "solver": "cv2.stereoCalibrate",
                **stereo_pair(replace(observations, uv=uv)),
                "points_left_out": 0,
                "farthest_px": float(apart.max()) if apart.any() else None,
                "more_than_a_pixel": int((apart > 1).sum()),
            }
        )
    return rows


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
