"""A calibration's figures in plain words, with the responsible camera or frame named."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.observations import Observations
from rigs.calibrate.quality.quality import Quality
from rigs.calibrate.quality.windows import MISFIT
from rigs.check.lines_of_sight import finite_rms
from rigs.files.text import some
from rigs.geometry.points import SILENT

# Limits above which a figure becomes a finding; lower ones would warn of sound calibrations
_CAMERA_CONTRADICTS = 2.0  # standard deviations, a camera's contradiction
_MORE_THAN_OTHERS = 1.4  # ratio to the other cameras' contradiction, to name one alone
_FRAME_CONTRADICTS = 2.5  # standard deviations, a frame's contradiction
_HIGH = 2.0  # ratio of one camera's residual, or the halves' difference, to what is usual
_HIGH_FRAME = 3.0  # ratio to the usual residual, one frame
_HIGH_NOISE = 1.0  # pixels
_LITTLE_COVERAGE = 0.6  # fraction of the volume's image; less is extrapolated
_HIGH_FOCAL_ERROR = 0.05  # relative standard deviation
_MANY_IMAGES = 0.2  # fraction of a camera's images left out: the camera is responsible
_MANY_POINTS = 0.1  # fraction of a camera's points left out


def findings(
    quality: Quality,
    observations: Observations,
    used: NDArray[np.bool_],
    noise: float,
    voxel: float | None = None,
    offsets: tuple[str, ...] | None = None,
    held: str = "given lens",
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return warnings about the rig, the gravest first, and notes on what was left out.

    ``offsets`` are each camera's offset in time in words, where a film shows it: it is then no
    cause. ``held`` is the lens that was held, in words. Where the rays meet within a tenth of
    ``voxel`` (of a pixel where None) only errors that displace them by more are reported.
    """
    least = _least_displacement(quality, voxel)
    causes = _causes(offsets, len(observations.cameras))
    warnings, notes = _left_out(quality, observations, used, causes, harmless=bool(least.all()))
    contradictions, frame_notes = _contradictions(quality, observations, used, least, offsets)
    warnings += contradictions
    notes += frame_notes
    warnings += _bad_images(quality, observations, used, noise, least, offsets, held)
    if noise > _HIGH_NOISE:
        warnings.append(
            f"residuals of {noise:.2g} px per coordinate, far above the error of detection: check "
            "that the target is described correctly"
        )
    warnings += [*_unmodelled(quality, voxel), *_thin_data(quality, observations, voxel)]
    return tuple(warnings), tuple(notes)


def assessment(
    quality: Quality,
    warnings: tuple[str, ...],
    notes: tuple[str, ...],
    length_unit: str,
    voxel: float | None = None,
) -> str:
    """Return a grade, the predicted ray-miss and its meaning, warnings and notes, in one text."""
    if len(quality.camera_rms) < 2:
        rms = float(quality.camera_rms[0])
        word = "doubtful" if warnings else "good"
        lines = [f"{word}: one camera, residuals {rms:.2g} px; no other rays to compare with"]
    elif not np.isfinite(quality.predicted_ray_miss):
        lines = ["doubtful: no point that the target covered is seen by two cameras"]
    else:
        ratio = quality.predicted_ray_miss / _reference(quality, voxel)
        word = "good" if ratio <= SILENT else "usable"
        word = "poor" if ratio > 1 else "doubtful" if warnings else word
        what = "pixel" if voxel is None else "voxel"
        cross = (
            f"; rigs of every other frame and of the rest differ by {quality.cross_ray_miss:.2g} "
            f"{length_unit} ({quality.cross_expected:.2g} expected)"
            if np.isfinite(quality.cross_ray_miss)
            else "; too few frames to check it on halves"
        )
        lines = [
            f"{word}: rays miss each other by {quality.predicted_ray_miss:.2g} {length_unit} RMS "
            f"in the volume, {ratio:.2g} of a {what}{cross}"
        ]
    return "\n".join([*lines, *warnings, *notes])


def _causes(offsets: tuple[str, ...] | None, cameras: int) -> list[str]:
    """Return for each camera why it may disagree, other than by its lens."""
    if offsets is None:
        return ["it moved or is not synchronised"] * cameras
    return [f"it moved (it is {words})" for words in offsets]


def _left_out(
    quality: Quality,
    observations: Observations,
    used: NDArray[np.bool_],
    causes: list[str],
    *,
    harmless: bool,
) -> tuple[list[str], list[str]]:
    """Return warnings and notes on what was left out: whole images, and single observations.

    Single observations are a note where the rays of those that remain meet: ``harmless``.
    """
    seen, kept = observations.counts(), observations.where(used).counts()
    # Images without residuals never had a pose
    out = (seen > 0) & (kept == 0) & np.isfinite(quality.image_rms)
    frames = observations.frames
    warnings, notes = [], []
    for camera, name, images, words in _many(observations, out):
        warnings.append(
            f"camera {name}: {words}, disagree with the other cameras and were left out: "
            f"{causes[camera]}"
        )
        out[camera, images] = False
    # When two disagree either may be left out, so the one that remains is as suspect
    alone = (kept > 0) & ((kept > 0).sum(axis=0) == 1) & out.any(axis=0)
    for camera, name, images, words in _many(observations, alone):
        warnings.append(
            f"camera {name}: in {words}, no other camera agrees with it: {causes[camera]}, or all "
            "others did"
        )
        out[:, images] = False
    for frame in np.flatnonzero((out.sum(axis=0) >= 2) & (kept.sum(axis=0) == 0)):
        cameras = [observations.cameras[camera] for camera in np.flatnonzero(out[:, frame])]
        notes.append(
            f"frame {frames[frame]}: cameras {', '.join(cameras)} disagree by "
            f"{np.nanmax(quality.image_rms[:, frame]):.2g} px, left out: the target moved, or an "
            "image is not synchronised"
        )
        out[:, frame] = False
    for camera, frame in np.argwhere(out):
        notes.append(
            f"camera {observations.cameras[camera]}, frame {frames[frame]}: disagrees with the "
            f"other cameras by {quality.image_rms[camera, frame]:.2g} px, left out: the camera "
            "moved or is not synchronised there, or the target was detected in a wrong order"
        )
    for camera, name in enumerate(observations.cameras):
        own = observations.camera == camera
        single = own & ~used & (kept[camera, observations.frame] > 0)
        if single.any():
            where = [frames[frame] for frame in np.unique(observations.frame[single])]
            line = (
                f"camera {name}: {int(single.sum())} of {int(own.sum())} points left out, "
                f"detected in the wrong place in frames {some(where)}"
            )
            many = single.sum() > _MANY_POINTS * own.sum()
            (warnings if many and not harmless else notes).append(line)
    return warnings, notes


def _many(
    observations: Observations, which: NDArray[np.bool_]
) -> Iterator[tuple[int, str, NDArray[np.int64], str]]:
    """Yield cameras with many of ``which`` images ``(cameras, frames)``, with these in words."""
    counts = (observations.counts() > 0).sum(axis=1)
    for camera, (name, of) in enumerate(zip(observations.cameras, counts, strict=True)):
        images = np.flatnonzero(which[camera])
        if len(images) >= 3 and len(images) > _MANY_IMAGES * of:
            first, last = (observations.frames[frame] for frame in images[[0, -1]])
            words = f"{len(images)} of its {of} images, from frame {first} to {last}"
            yield camera, name, images, words


def _contradictions(
    quality: Quality,
    observations: Observations,
    used: NDArray[np.bool_],
    least: NDArray[np.float64],
    offsets: tuple[str, ...] | None,
) -> tuple[list[str], list[str]]:
    """Return warnings on cameras and notes on frames that were used but contradict the others."""
    kept = observations.where(used).counts() > 0
    contradiction = np.where(kept, quality.contradiction, np.nan)
    cameras, frames = (np.sqrt(_mean(contradiction**2, axis)) for axis in (1, 0))
    if len(cameras) < 2:
        return [], []
    together = "one moved or is not synchronised" if offsets is None else "one moved"
    excess = np.where(kept, quality.image_rms**2 - quality.alone_rms**2, np.nan)
    moved, moved_frames = (np.sqrt(np.maximum(_mean(excess, axis), 0.0)) for axis in (1, 0))
    lines, notes = [], []
    worst = int(np.argmax(cameras))
    others = float(np.median(np.delete(cameras, worst)))
    name = observations.cameras[worst]
    if cameras[worst] > _CAMERA_CONTRADICTS and (moved >= least).any():
        alone = np.nan_to_num(finite_rms(np.where(kept, quality.alone_rms, np.nan)[worst]))
        rms = f"residuals {quality.camera_rms[worst]:.2g} px, {alone:.2g}"
        cause = _causes(offsets, len(cameras))[worst]
        if cameras[worst] > _MORE_THAN_OTHERS * others and len(cameras) > 2:
            lines.append(
                f"camera {name}: contradicts the others ({rms} by itself, {cameras[worst]:.2g} "
                f"standard deviations where {others:.2g} is usual): {cause}, "
                "or its lens is wrong"
            )
        else:
            lines.append(
                f"cameras contradict each other, {name} most ({rms} by itself, "
                f"{cameras[worst]:.2g} standard deviations): {together}, or the target is bent"
            )
    usual = float(np.nanmedian(frames))
    stands_out = frames > np.fmax(_FRAME_CONTRADICTS, 3 * usual)
    for frame in np.flatnonzero(stands_out & (moved_frames >= least.min())):
        most = int(np.nanargmax(contradiction[:, frame]))
        notes.append(
            f"frame {observations.frames[frame]}: cameras contradict each other on where the "
            f"target is ({frames[frame]:.2g} standard deviations where {usual:.2g} is usual), "
            f"{observations.cameras[most]} most: it or the target moved"
        )
    return lines, notes


def _bad_images(
    quality: Quality,
    observations: Observations,
    used: NDArray[np.bool_],
    noise: float,
    least: NDArray[np.float64],
    offsets: tuple[str, ...] | None,
    held: str,
) -> list[str]:
    """Return lines on cameras and frames that are noisy or bent even by themselves."""
    lines = []
    kept = observations.where(used).counts() > 0
    cameras = np.nan_to_num([finite_rms(row) for row in np.where(kept, quality.alone_rms, np.nan)])
    for camera, name in enumerate(observations.cameras):
        others = np.delete(cameras, camera)
        usual = float(np.median(others)) if len(others) else np.inf
        is_worst = cameras[camera] > _HIGH * usual and cameras[camera] == cameras.max()
        if is_worst and cameras[camera] >= least[camera]:
            lines.append(
                f"camera {name}: residuals {cameras[camera]:.2g} px by itself where others have "
                f"{usual:.2g} px: blur, or a lens beyond its model"
            )
        misfit = quality.lens_misfit[camera]
        if misfit > MISFIT and misfit * noise >= least[camera]:
            also = "" if offsets is None else f"; it is {offsets[camera]}"
            lines.append(
                f"camera {name}: its {held} does not fit what it saw "
                f"({misfit:.2g} standard deviations){also}"
            )
    usual = float(np.nanmedian(quality.frame_rms))
    for frame in np.flatnonzero(quality.frame_rms > _HIGH_FRAME * usual):
        worst = int(np.nanargmax(quality.image_rms[:, frame]))
        if quality.frame_rms[frame] < least[worst]:
            continue
        lines.append(
            f"frame {observations.frames[frame]}: residuals {quality.frame_rms[frame]:.2g} px "
            f"where {usual:.2g} px is usual, most in camera {observations.cameras[worst]}"
        )
    return lines


def _mean(values: NDArray, axis: int) -> NDArray[np.float64]:
    """Return the mean of the finite values along ``axis``; 0 without any."""
    finite = np.isfinite(values)
    total = np.where(finite, values, 0.0).sum(axis=axis)
    return total / np.maximum(finite.sum(axis=axis), 1)


def _reference(quality: Quality, voxel: float | None) -> float:
    """Return a voxel's edge length; a pixel's size where there are no voxels."""
    return float(np.nanmedian(quality.footprint)) if voxel is None else voxel


def _least_displacement(quality: Quality, voxel: float | None) -> NDArray[np.float64]:
    """Return the displacement in pixels from which errors are reported, ``(cameras,)``."""
    if not quality.predicted_ray_miss < SILENT * _reference(quality, voxel):
        return np.zeros(len(quality.footprint))
    pixels = np.ones(len(quality.footprint)) if voxel is None else voxel / quality.footprint
    return SILENT * np.where(np.isfinite(pixels), pixels, 1.0)


def _unmodelled(quality: Quality, voxel: float | None) -> list[str]:
    """Return a line where halves of the frames differ more than noise explains."""
    least = SILENT * _reference(quality, voxel)
    if not quality.cross_ray_miss > max(_HIGH * quality.cross_expected, least):
        return []
    return [
        f"halves of the frames differ {quality.cross_ray_miss / quality.cross_expected:.2g} times "
        "as much as noise explains: the target is bent, something moved, or a lens is beyond the "
        "model. The predicted ray-miss is too small"
    ]


def _thin_data(quality: Quality, observations: Observations, voxel: float | None) -> list[str]:
    """Return lines on cameras with too little data."""
    lines = []
    least = SILENT * _reference(quality, voxel)
    for camera, name in enumerate(observations.cameras):
        if len(quality.points) and np.isnan(quality.camera_ray_miss[camera]):
            lines.append(
                f"camera {name}: sees no part of the volume that another camera sees: the error "
                "of its rays there is unknown"
            )
        harmless = quality.camera_ray_miss[camera] < least if len(quality.points) else False
        if quality.focal_error[camera] > _HIGH_FOCAL_ERROR and not harmless:
            lines.append(
                f"camera {name}: focal length known to {100 * quality.focal_error[camera]:.2g} % "
                "only: tilt the target more and in different directions"
            )
        if quality.volume_coverage[camera] < _LITTLE_COVERAGE:
            lines.append(
                f"camera {name}: the target was seen in "
                f"{100 * quality.volume_coverage[camera]:.0f} % of where the image shows the "
                "volume: its lens is extrapolated in the rest"
            )
    return lines
