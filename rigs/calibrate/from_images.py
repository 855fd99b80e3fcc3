"""From images of a flat target to a calibrated rig, as ``flametomo calibrate-rig`` does it."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any, Literal

from rigs.calibrate.adjust.film import frame_times
from rigs.calibrate.calibration import calibrate
from rigs.calibrate.detect.detect import Detections, ImageSet, detections
from rigs.calibrate.detect.image_sets import check_not_split, image_set, notes_of
from rigs.calibrate.options import check_lens_options, check_options, common_lenses
from rigs.calibrate.result import Calibration
from rigs.calibrate.targets.boards import Target, parse_target
from rigs.files.text import some
from rigs.progress import Progress, progress_of, staged
from rigs.recordings import Mosaic
from rigs.rig import Rig

_EARLY = ("world", "rescale", "length_unit", "distortion", "scene")  # checked before the search


def calibrate_rig(
    images: str | os.PathLike | ImageSet,
    target: Target | str,
    *,
    intrinsics: Rig | None = None,
    intrinsics_images: str | os.PathLike | None = None,
    common_lens: Iterable[Collection[str]] | Literal["all"] = (),
    pattern: str | None = None,
    bayer: str | None = None,
    every: int = 1,
    cache: str | os.PathLike | None = None,
    progress: Progress | bool | None = None,
    **how: Any,
) -> Calibration:
    """Return the rig that took images of a flat target, and how far it can be trusted.

    The target was moved about in front of the cameras. Images are searched for it, and then
    `rigs.calibrate.calibrate` adjusts lenses, camera poses and target poses together.

    Parameters
    ----------
    images : path-like or mapping
        A folder with one folder of images, or one film, for each camera, see
        `rigs.calibrate.image_set`; or images by camera and by frame: files or grey arrays.
    target : Chessboard, CharucoBoard, CircleGrid or str
        The target, or its text like ``chessboard:9x6:25``.
    intrinsics : Rig, optional
        Cameras whose lenses are kept as they are.
    intrinsics_images : path-like, optional
        More images of the target, of each camera by itself, for its lens alone.
    common_lens : iterable of collections of str, or "all"
        Sets of cameras that share camera matrix and distortion.
    pattern, bayer : str, optional
        How files are named, and the order of the colours of mosaics, like ``RGGB``.
    every : int
        Use one picture of a film in this many.
    cache : path-like, optional
        A file that keeps the detections for the next run.
    progress : bool or callable, optional
        True shows a bar.
    how
        See `rigs.calibrate.calibrate`: ``world, rescale, length_unit, distortion, volume,
        square_pixels, fixed_center, scene, windows``.

    Returns
    -------
    calibration : Calibration
        ``notes`` says what is to be known of the images; ``images`` are those searched.

    Raises
    ------
    ValueError
        In one line: the file, camera or argument, what was found and what was expected.
    """
    bound = signature(calibrate).bind(
        None, **how
    )  # a wrong name ends it now, not after the search
    bound.apply_defaults()
    early = {name: bound.arguments[name] for name in _EARLY}
    target = parse_target(target) if isinstance(target, str) else target
    notes: list[str] = []
    mosaics = bayer is not None and bool(Mosaic(bayer.upper(), "g"))

    def read(source: str | os.PathLike | ImageSet) -> ImageSet:
        if isinstance(source, Mapping):
            return source
        return image_set(source, every, notes.append, pattern=pattern, are_mosaics=mosaics)

    if not isinstance(images, Mapping) and pattern is None:
        check_not_split(Path(images), intrinsics is not None or intrinsics_images is not None)
    found = read(images)
    frames = list(dict.fromkeys(frame for of_camera in found.values() for frame in of_camera))
    check_options(list(found), frames, intrinsics=intrinsics, target=target, **early)
    lens_sets = [list(found)] if common_lens == "all" else list(common_lens)
    known = {name: bound.arguments[name] for name in ("square_pixels", "fixed_center")}
    known |= {"intrinsics_images": intrinsics_images is not None, "common_lens": lens_sets}
    check_lens_options(intrinsics, known)
    common_lenses(list(found), lens_sets)
    if intrinsics_images is not None:
        found = _with_lens_images(found, read(intrinsics_images), intrinsics_images)
    with progress_of(progress, "calibrate") as tell:
        stage = staged(tell)
        search = stage("detect")
        seen = detections(
            found,
            target,
            cache=cache,
            progress=search and (lambda done, total: search(done, total, "")),
        )
        adjust = stage("adjust")
        calibration = calibrate(
            seen.observations,
            intrinsics=intrinsics,
            target=target,
            common_lens=lens_sets,
            times=frame_times(frames),
            progress=adjust and (lambda step: adjust(0, 0, step)),
            **how,
        )
    return replace(calibration, notes=(*notes, *_notes(found, seen)), images=found)


def _with_lens_images(found: ImageSet, lenses: ImageSet, folder: str | os.PathLike) -> ImageSet:
    """Return the images of cameras with those of their lenses, in frames of their own."""
    for camera in lenses:
        if camera not in found:
            raise ValueError(
                f"intrinsics_images: {Path(folder)}: found {camera}, expected names of cameras as "
                f"in the images: {', '.join(found)}"
            )
    return {
        camera: {
            **frames,
            **{f"lens {camera} {name}": source for name, source in lenses.get(camera, {}).items()},
        }
        for camera, frames in found.items()
    }


def _notes(found: ImageSet, seen: Detections) -> list[str]:
    """Return lines on files, blurred images, and cameras whose images lack the target."""
    notes = [
        f"camera {camera}: {_name_of(found, camera, frame)}: edges are blurred over {blur:.2g} "
        "px, twice as much as is usual or more"
        for camera, frame, blur in seen.blurred()
        if math.isfinite(blur)
    ]
    for camera, frames in found.items():
        without = [frame for frame in frames if (camera, frame) in seen.reasons]
        if without:
            notes.append(
                f"camera {camera}: target not found in {len(without)} of {len(frames)} images: "
                f"{some(without)}"
            )
    return notes + notes_of(found)


def _name_of(found: ImageSet, camera: str, frame: str) -> str:
    """Return the file of an image; an array has none."""
    source = found[camera][frame]
    return f"frame {frame}" if hasattr(source, "shape") else str(source)
