"""Scans on disk: scan.yaml, transforms.json, and a rig beside a folder of images."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from itertools import islice
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any

from rigs import Rig, formats, load_rig
from rigs.files.text import breaks_a_line, read_yaml_mapping
from rigs.recordings import IMAGE_SUFFIXES, RawLayout, find_images, split_member
from rigs.recordings.layout import how_to_name, natural
from tomo.grid import VoxelGrid, grid_of_rig
from tomo.scan._schema import SCAN_FORMAT, parse_scan_file
from tomo.scan.corrections import Corrections
from tomo.scan.films import Film, films_in, frame_rate_of, frames_of_films, notes_of_films
from tomo.scan.frames import Frame
from tomo.scan.radiometry import Calibration, Radiometry
from tomo.scan.scan import Scan
from tomo.scan.write import SCAN_FILE, check_cameras

if TYPE_CHECKING:
    from os import PathLike

_MOST_LISTED = 10_000
"""Files looked at for a message: more take seconds where a whole disk is given."""

_COLOURS = ("corrections.bayer", "corrections.channel")


def load_scan(path: str | PathLike, images: str | PathLike | None = None) -> Scan:
    """Load a scan folder, its ``scan.yaml``, or a NeRF-style ``transforms.json``.

    Parameters
    ----------
    path : path-like
    images : path-like, optional
        The folder of the images of a ``transforms.json``, in place of the paths in it: an image
        is found there by the end of its path, as much of it as is there.

    Raises
    ------
    ValueError
        One line that names file, camera and field.
    FileNotFoundError
        If there is nothing at ``path``.
    """
    path = Path(path)
    if path.is_dir():
        found = [path / name for name in (SCAN_FILE, "transforms.json") if (path / name).is_file()]
        if not found:
            raise FileNotFoundError(f"{path}: found neither {SCAN_FILE} nor transforms.json")
        path = found[0]
    elif not path.is_file():
        raise FileNotFoundError(f"{path}: no such scan")
    if path.suffix.lower() == ".json":
        return _load_transforms(path, None if images is None else Path(images))
    if images is not None:
        raise ValueError(
            f"{path}: images: found {images}, expected none, as a scan.yaml names its images"
        )
    if path.suffix.lower() in (".yaml", ".yml"):
        return _load_scan_file(path)
    raise ValueError(
        f"{path}: scan: found suffix {path.suffix!r}, expected a folder, .yaml or .json"
    )


def is_scan_file(path: Path) -> bool:
    """Tell by its ``format`` whether a YAML file is a scan's, whatever it is called."""
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file():
        return False
    try:
        return read_yaml_mapping(path).get("format") == SCAN_FORMAT
    except ValueError:  # whoever reads it as a rig says what is wrong
        return False


def _load_transforms(path: Path, folder: Path | None) -> Scan:
    from rigs.formats.transforms import load_transforms

    if folder is not None and not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder of images")
    rig, listed = load_transforms(path)
    frames = []
    used: dict[Any, Any] = {}
    for name, images in listed:
        found = {}
        for camera, image in images.items():
            field = f"frame {name!r}: camera {camera}: file_path"
            text = image.relative_to(path.parent) if image.is_relative_to(path.parent) else image
            if folder is None:
                found[camera] = _image_inside(path, str(text), field)
            else:
                file = found[camera] = _image_in(folder, PurePosixPath(text), field)
                if file in used:
                    raise ValueError(f"{folder}: {field}: found {file} for {used[file]} too, "
                                     f"expected one file an image, as in {text}")  # fmt: skip
                used[file] = f"camera {camera} of frame {name!r}"
        frames.append(Frame(name, found))
    return Scan(rig, tuple(frames), grid=grid_of_rig(rig), source=path)


def _image_inside(path: Path, text: str, field: str) -> Path:
    """Return the image that a ``transforms.json`` names in its folder."""
    try:
        return _inside(path, text, field)
    except ValueError as error:
        raise ValueError(f"{error}, or --images FOLDER that has files of that name") from None


def _image_in(folder: Path, image: PurePosixPath, field: str) -> Path:
    """Return the file in ``folder`` that ends like the path of an image."""
    parts = [part for part in image.parts if part not in ("/", "..")]
    for start in range(len(parts)):
        file = folder.joinpath(*parts[start:])
        if file.is_file() and file.resolve().is_relative_to(folder.resolve()):
            return file
    raise FileNotFoundError(
        f"{folder}: {field}: found no file {parts[-1]}, expected it there or in a folder of it as "
        f"in {image}"
    )


def _load_scan_file(path: Path) -> Scan:
    content = parse_scan_file(path)
    rig = load_rig(_inside(path, content.rig, "rig"))
    for frame in content.frames or ():
        check_cameras(path, f"frame {frame.name!r}", frame.images, rig)
    frames = tuple(
        Frame(
            frame.name,
            {
                camera: _inside(path, image, f"frame {frame.name!r}: camera {camera}")
                for camera, image in frame.images.items()
            },
        )
        for frame in content.frames or ()
    )
    films, rate = {}, content.frame_rate
    if content.films is not None:
        films = _films_of(path, content.films, rig)
        frames = tuple(Frame(*one) for one in frames_of_films(films).items())
        rate = rate or frame_rate_of(films)
    corrections = _each(path, content.corrections.model_dump(), "corrections", rig)
    grid = grid_of_rig(rig)
    if content.grid is not None:
        try:
            grid = VoxelGrid(tuple(content.grid.shape), content.grid.spacing, content.grid.center)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
    truth = None if content.truth is None else _inside(path, content.truth, "truth")
    effects = None if content.effects is None else content.effects.model_dump()
    if effects is not None:
        check_cameras(path, "effects.gains", effects["gains"], rig)
    return Scan(
        rig,
        frames,
        Corrections(**corrections),
        grid,
        truth,
        source=path,
        effects=effects,
        frame_rate=rate,
        notes=notes_of_films(films) if films else (),
        radiometry=_radiometry(path, content.radiometry, rig),
    )


def _each(path: Path, content: dict[str, Any], field: str, rig: Rig) -> dict[str, Any]:
    """Return values that are one for all cameras, or one for each, with paths in place of text."""
    found = {}
    for name, value in content.items():
        where = f"{field}.{name}"
        if isinstance(value, dict):
            check_cameras(path, where, value, rig)
            found[name] = {c: _plain(path, v, f"{where}: camera {c}") for c, v in value.items()}
        else:
            found[name] = _plain(path, value, where)
    return found


def _radiometry(path: Path, content: Any, rig: Rig) -> Radiometry | None:
    """Return what a scan.yaml says of absolute light; units that do not fit are refused."""
    if content is None:
        return None
    given = content.model_dump()
    units = {name: given.pop(name) for name in ("unit", "volume_unit")}
    known = _each(path, given.pop("calibration"), "radiometry.calibration", rig)
    rest = _each(path, given, "radiometry", rig)
    try:
        return Radiometry(**units, **rest, calibration=Calibration(**known))
    except ValueError as error:
        raise ValueError(f"{path}: radiometry.{error}") from None


def _films_of(path: Path, entries: dict[str, Any], rig: Rig) -> dict[str, Film]:
    """Return the films that a scan.yaml names, by camera."""
    check_cameras(path, "films", entries, rig)
    films = {}
    for camera, entry in entries.items():
        file = _inside(path, entry.path, f"films: camera {camera}")
        if not split_member(file)[0].exists():
            raise FileNotFoundError(f"{file}: camera {camera}: no such film")
        raw = None if entry.raw is None else RawLayout(**entry.raw.model_dump())
        films[camera] = Film(file, entry.first, entry.step, entry.offset, raw)
    return films


def _inside(scan_file: Path, text: str, field: str) -> Path:
    """Return the path that a file names, refusing any that leaves the file's folder."""
    folder = scan_file.parent
    posix, windows = PurePosixPath(text), PureWindowsPath(text)
    leaves = posix.is_absolute() or bool(windows.drive or windows.root)
    leaves = leaves or ".." in posix.parts or ".." in windows.parts
    try:
        leaves = leaves or not (folder / text).resolve().is_relative_to(folder.resolve())
        (folder / text).exists()  # a name that no file system can hold raises here
        if breaks_a_line(text):
            raise ValueError
    except (OSError, ValueError, RuntimeError):
        raise ValueError(
            f"{scan_file}: {field}: found {reprlib.repr(text)}, expected a path"
        ) from None
    if leaves or not text:
        raise ValueError(
            f"{scan_file}: {field}: found {text!r}, expected a path inside the scan folder"
        )
    return folder / text


def _plain(scan_file: Path, value: Any, field: str) -> Any:
    """Return a correction's value: the name of colours, a number, or the path of an image."""
    is_path = isinstance(value, str) and field.split(":")[0] not in _COLOURS
    return _inside(scan_file, value, field) if is_path else value


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
    rig = rig if isinstance(rig, Rig) else formats.load(rig)
    folder = Path(images)
    films = films_in(folder, rig.names) if pattern is None else {}
    if films:
        settings.setdefault("grid", grid_of_rig(rig))
        settings |= {"frame_rate": frame_rate_of(films), "notes": notes_of_films(films)}
        moments = frames_of_films(films).items()
        return Scan(rig, tuple(Frame(*one) for one in moments), source=folder, **settings)
    found = find_images(folder, rig.names, pattern)
    for camera in rig.names:
        if camera not in found:
            raise _no_images(folder, camera, rig.names, pattern)
    frames: dict[str, dict[str, Path]] = {}
    for camera in rig.names:
        for frame, path in found[camera].items():
            frames.setdefault(frame, {})[camera] = path
    settings.setdefault("grid", grid_of_rig(rig))
    ordered = tuple(Frame(name, frames[name]) for name in sorted(frames, key=natural))
    return Scan(rig, ordered, source=folder, **settings)


def _no_images(
    folder: Path, camera: str, cameras: Sequence[str], pattern: str | None
) -> ValueError | FileNotFoundError:
    """Return the error about a camera whose images are not found."""
    some = islice(folder.rglob("*"), _MOST_LISTED)
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
