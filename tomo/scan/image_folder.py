"""The scan of a rig and a folder of its cameras' images or films."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigs import Rig, formats
from rigs.recordings import IMAGE_SUFFIXES, find_images
from rigs.recordings.layout import how_to_name, natural
from tomo.grid import grid_of_rig
from tomo.scan.corrections import recorded
from tomo.scan.films import Frame, films_in, frame_rate_of, frames_of_films, notes_of_films
from tomo.scan.scan import Scan

if TYPE_CHECKING:
    from os import PathLike


def scan_of_images(
    rig: Rig | str | PathLike,
    images: str | PathLike,
    pattern: str | None = None,
    **settings: Any,
) -> Scan:
    """Return the scan of a rig (or a rig file) and a folder of its cameras' images.

    Parameters
    ----------
    rig : Rig or path-like
    images : path-like
        A folder of ``cam00/0001.tif``, ``cam00_0001.tif`` or ``cam00.tif``, see
        `rigs.recordings.find_images`; or of a film ``cam00.tif`` or ``cam00.cine`` a camera.
    pattern : str, optional
        How files are named otherwise, like ``{frame}/{camera}.tif``.
    **settings
        Further fields of Scan: ``corrections``, ``grid``.

    Raises
    ------
    ValueError
        If two images of a camera are of one frame, a camera's folder is empty, or names do not
        fit the pattern.
    FileNotFoundError
        If there is no such folder, or nothing in it is named as a camera.
    """
    origin: dict[str, Any] = {} if pattern is None else {"pattern": pattern}
    if not isinstance(rig, Rig):
        origin["rig"] = str(Path(rig).absolute())
        rig = formats.load(rig)
    if "corrections" in settings:
        given = vars(settings["corrections"]).items()
        origin["corrections"] = recorded({name: one for name, one in given if one is not None})
    settings["origin"] = origin
    folder = Path(images)
    films = films_in(folder, rig.names) if pattern is None else {}
    if films:
        settings |= {"frame_rate": frame_rate_of(films), "notes": notes_of_films(films)}
    frames = frames_of_films(films) if films else frames_in(folder, rig, pattern)
    return Scan(rig, frames, source=folder, **{"grid": grid_of_rig(rig), **settings})


def frames_in(folder: Path, rig: Rig, pattern: str | None) -> tuple[Frame, ...]:
    """Return the frames of a folder's images, in natural order; errors as `scan_of_images`."""
    found = find_images(folder, rig.names, pattern)
    for camera in rig.names:
        if camera not in found:
            raise _no_images(folder, camera, rig.names, pattern)
    return frames_of_images({camera: found[camera] for camera in rig.names})


def frames_of_images(found: Mapping[str, Mapping[str, Path]]) -> tuple[Frame, ...]:
    """Return the frames of images by camera and by frame, in natural order of their names."""
    frames: dict[str, dict[str, Path]] = {}
    for camera, own in found.items():
        for frame, path in own.items():
            frames.setdefault(frame, {})[camera] = path
    return tuple(Frame(name, frames[name]) for name in sorted(frames, key=natural))


def _no_images(
    folder: Path, camera: str, cameras: Sequence[str], pattern: str | None
) -> ValueError | FileNotFoundError:
    """Return the error about a camera whose images are not found."""
    some = chain(folder.glob("*"), folder.glob("*/*"))  # deeper may be a whole disk
    inside = sorted(path for path in some if path.suffix.lower() in IMAGE_SUFFIXES)
    first = f", the first {inside[0].relative_to(folder)}" if inside else ""
    if pattern is not None:
        return ValueError(
            f"{folder}: camera {camera}: pattern: found no image whose name fits {pattern!r} with "
            f"{{camera}} {camera}, but {len(inside)} others{first}; expected "
            f"{how_to_name(inside, folder, cameras)}"
        )
    if (folder / camera).is_dir():
        return ValueError(
            f"{folder / camera}: camera {camera}: found no image, expected files that end in "
            f"{', '.join(IMAGE_SUFFIXES)}; or take it out of the rig: "
            f"flametomo convert-rig rig.yaml new.yaml --drop {camera}"
        )
    others = ", ".join(sorted(path.name for path in folder.iterdir() if path.is_dir()))
    return FileNotFoundError(
        f"{folder}: camera {camera}: found no folder {camera} in it and no image of that name; it "
        f"has {others or 'no folders'} and {len(inside)} images in all{first}; expected "
        f"{how_to_name(inside, folder, cameras)}; or take it out of the rig: "
        f"flametomo convert-rig rig.yaml new.yaml --drop {camera}"
    )
