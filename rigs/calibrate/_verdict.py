"""A calibration's figures in plain words, with the guilty camera or frame named."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.observations import Observations
from rigs.calibrate.quality import Quality

_MANY_IMAGES = 0.2  # of a camera's images left out: the camera is to blame
_HIGH_RMS = 2.0  # times the usual, of a camera
_HIGH_IMAGE = 2.5  # of an image
_HIGH_FRAME = 3.0  # of a frame
_HIGH_CROSS = 2.0  # times what is expected
_LITTLE_COVERAGE = 0.5
_HIGH_FOCAL_ERROR = 0.01
_GOOD_MISS = 0.1  # of a pixel's footprint


def findings(
    quality: Quality,
    observations: Observations,
    used: NDArray[np.bool_],
    given_lenses: bool,
) -> tuple[str, ...]:
    """Return what is wrong, the gravest first: a line each, nothing when all is well."""
    return (
        *_left_out(quality, observations, used),
        *_high_residuals(quality, observations, given_lenses),
        *_unmodelled(quality),
        *_thin_data(quality, observations),
    )


def verdict(quality: Quality, found: tuple[str, ...], length_unit: str) -> str:
    """Return the figure that counts, what it means, and the findings, in one text."""
    if not np.isfinite(quality.predicted_ray_miss):
        rms = np.sqrt(np.nanmean(quality.camera_rms**2))
        lines = [f"one camera: its lens is known, no rays to compare; residuals {rms:.3g} px"]
    else:
        footprint = float(np.nanmedian(quality.footprint))
        miss = quality.predicted_ray_miss
        pixels = miss / footprint
        word = "good" if pixels <= _GOOD_MISS and not found else "usable"
        if pixels > 1:
            word = "poor"
        elif found:
            word = "doubtful"
        cross = quality.cross_ray_miss
        checked = (
            f"; rigs of every other frame and of the rest differ by {cross:.2g} {length_unit} "
            f"({quality.cross_expected:.2g} expected)"
            if np.isfinite(cross)
            else "; too few frames to check it on halves"
        )
        lines = [
            f"{word}: rays miss each other by {miss:.2g} {length_unit} RMS in the volume, "
            f"{pixels:.2g} of a pixel{checked}"
        ]
    return "\n".join([*lines, *found])


def _left_out(quality: Quality, observations: Observations, used: NDArray[np.bool_]) -> list[str]:
    """Return lines on what was left out: whole images by camera and frame, single sightings."""
    shape = observations.counts().shape
    seen, kept = np.zeros(shape, int), np.zeros(shape, int)
    np.add.at(seen, (observations.camera, observations.frame), 1)
    np.add.at(kept, (observations.camera[used], observations.frame[used]), 1)
    # Images without residuals never had a pose: no disagreement, and told elsewhere
    out = (seen > 0) & (kept == 0) & np.isfinite(quality.image_rms)
    lines = []
    frames_whole = out.any(axis=0) & (out.sum(axis=0) >= 2) & (kept.sum(axis=0) == 0)
    for camera, name in enumerate(observations.cameras):
        images = np.flatnonzero(out[camera])
        if len(images) >= 3 and len(images) > _MANY_IMAGES * (seen[camera] > 0).sum():
            first, last = (observations.frames[frame] for frame in images[[0, -1]])
            lines.append(
                f"camera {name}: {len(images)} of its {int((seen[camera] > 0).sum())} images, "
                f"from frame {first} to {last}, disagree with the other cameras and were left "
                "out: it moved or is out of step"
            )
            out[camera] = False
    for frame in np.flatnonzero(frames_whole & out.any(axis=0)):
        cameras = [observations.cameras[camera] for camera in np.flatnonzero(out[:, frame])]
        rms = float(np.nanmax(quality.image_rms[:, frame]))
        lines.append(
            f"frame {observations.frames[frame]}: cameras {', '.join(cameras)} disagree by "
            f"{rms:.2g} px and it was left out: the target moved, or an image is out of step"
        )
        out[:, frame] = False
    for camera, frame in np.argwhere(out):
        lines.append(
            f"camera {observations.cameras[camera]}, frame {observations.frames[frame]}: "
            f"disagrees with the other cameras by {quality.image_rms[camera, frame]:.2g} px and "
            "was left out: the camera moved or is out of step there"
        )
    single = ~used & (kept[observations.camera, observations.frame] > 0)
    for camera, name in enumerate(observations.cameras):
        count = int((single & (observations.camera == camera)).sum())
        if count:
            total = int((observations.camera == camera).sum())
            worst = np.unique(observations.frame[single & (observations.camera == camera)])
            named = ", ".join(observations.frames[frame] for frame in worst[:5])
            more = "" if len(worst) <= 5 else f" and {len(worst) - 5} more"
            lines.append(
                f"camera {name}: {count} of {total} points left out, detected in the wrong place "
                f"in frames {named}{more}"
            )
    return lines


def _high_residuals(quality: Quality, observations: Observations, given_lenses: bool) -> list[str]:
    """Return lines on cameras, images and frames whose residuals stand out."""
    lines = []
    alone = np.where(np.isfinite(quality.alone_rms), quality.alone_rms, np.nan)
    seen = np.isfinite(quality.image_rms) & np.isfinite(alone)
    by_itself = np.array([_rms(row[on]) for row, on in zip(alone, seen, strict=True)])
    together = quality.camera_rms
    blamed = set()
    for camera, name in enumerate(observations.cameras):
        others = np.delete(together, camera)
        usual = float(np.median(others)) if len(others) else np.inf
        if together[camera] > _HIGH_RMS * usual and together[camera] == np.nanmax(together):
            blamed.add(camera)
            if together[camera] > _HIGH_RMS * by_itself[camera]:
                cause = "though it agrees with itself: it moved, or is out of step"
            elif given_lenses:
                cause = "even by itself: its given lens does not fit"
            else:
                cause = "even by itself: blur, a bent target or a lens beyond the model"
            lines.append(
                f"camera {name}: residuals {together[camera]:.2g} px where others have "
                f"{usual:.2g} px, {cause}"
            )
    contradicting = [
        camera
        for camera in range(len(together))
        if camera not in blamed and together[camera] > _HIGH_RMS * by_itself[camera]
    ]
    if contradicting and not blamed:
        worst = max(contradicting, key=lambda camera: together[camera] / by_itself[camera])
        lines.append(
            f"camera {observations.cameras[worst]}: residuals {together[worst]:.2g} px, "
            f"{by_itself[worst]:.2g} px by itself: cameras contradict each other, this one most"
        )
    lines += _high_images(quality, observations, alone, blamed)
    usual = float(np.nanmedian(quality.frame_rms))
    for frame in np.flatnonzero(quality.frame_rms > _HIGH_FRAME * usual):
        worst = int(np.nanargmax(quality.image_rms[:, frame]))
        lines.append(
            f"frame {observations.frames[frame]}: residuals {quality.frame_rms[frame]:.2g} px "
            f"where {usual:.2g} px is usual, most in camera {observations.cameras[worst]}"
        )
    return lines


def _high_images(
    quality: Quality, observations: Observations, alone: NDArray, blamed: set[int]
) -> list[str]:
    """Return a line for each camera with images that were kept but contradict the others."""
    lines = []
    for camera, name in enumerate(observations.cameras):
        usual = np.nanmedian(quality.image_rms[camera])
        limit = _HIGH_IMAGE * np.fmax(alone[camera], usual)
        kept = np.isfinite(quality.frame_rms) & (quality.image_rms[camera] < 5 * usual)
        high = np.flatnonzero(kept & (quality.image_rms[camera] > limit))
        if len(high) and camera not in blamed:
            named = ", ".join(observations.frames[frame] for frame in high[:5])
            more = "" if len(high) <= 5 else f" and {len(high) - 5} more"
            worst = high[np.argmax(quality.image_rms[camera, high])]
            lines.append(
                f"camera {name}: residuals up to {quality.image_rms[camera, worst]:.2g} px in "
                f"frames {named}{more}, {alone[camera, worst]:.2g} px by itself: it or the "
                "target moved"
            )
    return lines


def _rms(values: NDArray) -> float:
    """Return the root mean square; infinity of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.inf


def _unmodelled(quality: Quality) -> list[str]:
    """Return a line where halves of the frames differ more than noise explains."""
    if quality.cross_ray_miss > _HIGH_CROSS * quality.cross_expected:
        return [
            f"halves of the frames differ {quality.cross_ray_miss / quality.cross_expected:.2g} "
            "times as much as noise explains: the target is bent, something moved, or a lens is "
            "beyond the model; the predicted ray-miss is too good"
        ]
    return []


def _thin_data(quality: Quality, observations: Observations) -> list[str]:
    """Return lines on cameras of which too little is known."""
    lines = []
    for camera, name in enumerate(observations.cameras):
        if quality.focal_error[camera] > _HIGH_FOCAL_ERROR:
            lines.append(
                f"camera {name}: focal length known to {100 * quality.focal_error[camera]:.2g} % "
                "only: tilt the target more and in different directions"
            )
        if quality.image_coverage[camera] < _LITTLE_COVERAGE:
            lines.append(
                f"camera {name}: the target covered {100 * quality.image_coverage[camera]:.0f} % "
                "of the image: its lens is extrapolated in the rest"
            )
    return lines
