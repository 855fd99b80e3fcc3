"""What a calibration left out, in plain words, with the responsible camera or frame named."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.observations import Observations
from rigs.calibrate.quality.quality import Quality

_MANY_IMAGES = 0.2  # fraction of a camera's images left out: the camera is responsible
_MANY_POINTS = 0.1  # fraction of a camera's points left out


def causes_besides_lens(offsets: tuple[str, ...] | None, cameras: int) -> list[str]:
    """Return for each camera why it may disagree, other than by its lens."""
    if offsets is None:
        return ["it moved or is not synchronised"] * cameras
    return [f"it moved (it is {words})" for words in offsets]


def left_out(
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
    shape = observations.counts().shape
    seen, kept = observations.counts(), np.zeros(shape, int)
    np.add.at(kept, (observations.camera[used], observations.frame[used]), 1)
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
                f"detected in the wrong place in frames {', '.join(where[:5])}"
                + (f" and {len(where) - 5} more" if len(where) > 5 else "")
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
