"""Dark and flat frames in a folder: the value of scan.yaml that finds them for each camera."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from rigs import Rig
from rigs.files.size_guard import path_inside
from rigs.recordings.layout import common_start
from rigs.recordings.naming import Named, patterns_of
from tomo.scan.films import FilmFrame
from tomo.scan.image_source import MeanImage, images_by_camera
from tomo.scan.propose.camera_images import sizes_of
from tomo.scan.propose.contents import Contents, UndecidedError, kind_of

FRAMES = "{frame}"


def correction_of(
    contents: Contents, name: str, rig: Rig, images: str, dropped: Sequence[str] = ()
) -> str | None:
    """Return scan.yaml's value for dark or flat frames, those beside images first; None: none."""
    files = contents.dark if name == "dark" else contents.flat
    if not files:
        return None
    found = patterns_of(files, (*rig.names, *dropped))
    whole = {one: named for one, named in found.items() if set(named) >= set(rig.names)}
    values = {one: _value(contents.folder, name, one, named, rig) for one, named in whole.items()}
    beside = [value for one, value in values.items() if _place(one) == _place(images)]
    chosen = beside if len(beside) == 1 else list(dict.fromkeys(values.values()))
    if len(chosen) > 1:
        raise UndecidedError(contents.folder, f"{name} frames", chosen, name)
    if chosen:
        return chosen[0]
    if found:
        best = max(found, key=lambda one: len(found[one]))
        camera = next(one for one in rig.names if one not in found[best])
        raise ValueError(
            f"{contents.folder}: camera {camera}: {name}: found no frame named {best}, as "
            f"{len(found[best])} of {len(rig)} cameras have; expected one, or {name}='none'"
        )
    if len(files) == 1:
        return files[0].as_posix()
    raise ValueError(
        f"{contents.folder}: {name}: found {len(files)} frames, the first {files[0]}, none named "
        f"as a camera of the rig; expected {name}/{rig.names[0]}/0001.tif, or {name}='none', "
        "which leaves them out"
    )


def check_correction(folder: Path, name: str, value: Any, rig: Rig) -> dict[str, int]:
    """Return how many frames each camera has for a correction; 0 where it is a number."""
    if isinstance(value, int | float):
        return dict.fromkeys(rig.names, 0)
    found = images_by_camera(name, folder / value, rig.names)
    path_inside(value, folder, f"{folder}: {name}", "scan's")
    counts = {}
    for camera in rig:
        own = found[camera.name] if isinstance(found, dict) else found
        images = own.images if isinstance(own, MeanImage) else (own,)
        for size, path in sizes_of(images).items():
            if size != tuple(camera.image_size):
                raise ValueError(
                    f"{path}: camera {camera.name}: {name}: found {size[0]} x {size[1]} pixels, "
                    f"expected {camera.image_size[0]} x {camera.image_size[1]} as its images have"
                )
        counts[camera.name] = len(images)
    return counts


def _place(pattern: str) -> str:
    """Return the folder of a pattern above its camera, its frame, and what says dark or flat."""
    above = re.split(r"[{*]", pattern)[0].rpartition("/")[0]
    return "/".join(
        part for part in PurePosixPath(above).parts if not kind_of(PurePosixPath(part))
    )


def _value(folder: Path, name: str, pattern: str, named: Named, rig: Rig) -> str:
    """Return the value that finds the frames of a pattern, and no others."""
    wanted = {camera: {folder / path for path in named[camera].values()} for camera in rig.names}
    start = common_start([frame for own in named.values() for frame in own])
    for value in _ways(pattern, start.rstrip("0123456789")):
        try:
            found = images_by_camera(name, folder / value, rig.names)
        except ValueError:
            continue
        if isinstance(found, dict) and all(
            _files(found.get(camera)) == own for camera, own in wanted.items()
        ):
            return value
    raise ValueError(
        f"{folder}: {name}: found frames named {pattern} among other images, expected them in a "
        f"folder of their own: {name}/{rig.names[0]}, say"
    )


def _ways(pattern: str, start: str) -> Iterator[str]:
    """Yield values that could find a pattern's frames, named ``start``..., simple ones first."""
    if FRAMES not in pattern and "*" not in pattern:
        yield pattern
    parts = PurePosixPath(pattern).parts
    for end in range(1, len(parts)):
        if FRAMES not in "/".join(parts[:end]) and "*" not in "/".join(parts[:end]):
            yield "/".join(parts[:end])
    yield pattern.replace(FRAMES, "*")
    yield pattern.replace(FRAMES, f"{start}*")


def _files(found: object) -> set[Path]:
    """Return the files of a camera's correction."""
    images = found.images if isinstance(found, MeanImage) else (found,)
    return {
        one.film.path if isinstance(one, FilmFrame) else one
        for one in images
        if isinstance(one, Path | FilmFrame)
    }
