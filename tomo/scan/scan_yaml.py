"""Reading scan.yaml: its rig, frames or films, corrections and light; paths stay in its folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rigs import Rig, load_rig
from rigs.files.size_guard import path_inside
from rigs.recordings import RawLayout, split_member
from tomo.grid import VoxelGrid, grid_of_rig
from tomo.scan._schema import parse_scan_file
from tomo.scan.corrections import Corrections
from tomo.scan.films import Film, frame_rate_of, frames_of_films, notes_of_films
from tomo.scan.image_folder import frames_in
from tomo.scan.image_source import Frame, MeanImage
from tomo.scan.radiometry import Calibration, Radiometry
from tomo.scan.scan import Scan
from tomo.scan.write import check_cameras

_COLOURS = ("corrections.bayer", "corrections.channel")


def load_scan_yaml(path: Path) -> Scan:
    """Return the scan of a ``scan.yaml``; errors are a line that names file and field."""
    content = parse_scan_file(path)
    rig = load_rig(inside_scan(path, content.rig, "rig"))
    for frame in content.frames or ():
        check_cameras(path, f"frame {frame.name!r}", frame.images, rig)
    frames = tuple(
        Frame(
            frame.name,
            {
                camera: inside_scan(path, image, f"frame {frame.name!r}: camera {camera}")
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
    if content.images is not None:
        frames = _frames_named(path, content.images, rig)
    corrections = _corrections(path, content.corrections.model_dump(), rig)
    grid = grid_of_rig(rig)
    if content.grid is not None:
        try:
            grid = VoxelGrid(tuple(content.grid.shape), content.grid.spacing, content.grid.center)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
    truth = None if content.truth is None else inside_scan(path, content.truth, "truth")
    effects = None if content.effects is None else content.effects.model_dump()
    if effects is not None:
        check_cameras(path, "effects.gains", effects["gains"], rig)
    return Scan(
        rig,
        frames,
        corrections,
        grid,
        truth,
        source=path,
        effects=effects,
        frame_rate=rate,
        notes=notes_of_films(films) if films else (),
        radiometry=_radiometry(path, content.radiometry, rig),
        peak=content.peak,
    )


def _frames_named(path: Path, pattern: str, rig: Rig) -> tuple[Frame, ...]:
    """Return the frames of the images that a pattern names, all inside the scan's folder."""
    try:
        frames = frames_in(path.parent, rig, pattern)
    except ValueError as error:
        said = str(error).removeprefix(f"{path.parent}: ").removeprefix("pattern: ")
        raise ValueError(f"{path}: images: {said}") from None
    for frame in frames:
        _check_inside(path, frame.images.values(), f"frame {frame.name!r}")
    return frames


def _corrections(path: Path, content: dict[str, Any], rig: Rig) -> Corrections:
    """Return the corrections, those images that folders stand for inside the scan's folder too."""
    given = _each(path, content, "corrections", rig)
    try:
        found = Corrections(**given).by_camera(rig.names)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    for name, value in vars(found).items():
        each = value.values() if isinstance(value, Mapping) else (value,)
        _check_inside(path, each, f"corrections.{name}")
    return found


def _check_inside(path: Path, images: Iterable[Any], field: str) -> None:
    """Refuse image files that leave the scan's folder by a link."""
    for image in images:
        if isinstance(image, MeanImage):
            _check_inside(path, image.images, field)
        elif isinstance(image, Path):
            inside_scan(path, str(image.relative_to(path.parent)), field)


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
        file = inside_scan(path, entry.path, f"films: camera {camera}")
        if not split_member(file)[0].exists():
            raise FileNotFoundError(f"{file}: camera {camera}: no such film")
        raw = None if entry.raw is None else RawLayout(**entry.raw.model_dump())
        films[camera] = Film(file, entry.first, entry.step, entry.offset, raw)
    return films


def _plain(scan_file: Path, value: Any, field: str) -> Any:
    """Return a correction's value: the name of colours, a number, or the path of an image."""
    is_path = isinstance(value, str) and field.split(":")[0] not in _COLOURS
    return inside_scan(scan_file, value, field) if is_path else value


def inside_scan(scan_file: Path, text: str, field: str) -> Path:
    """Return the path that a file names, refusing any that leaves the file's folder."""
    return path_inside(text, scan_file.parent, f"{scan_file}: {field}", "scan")
