"""Scans on disk, a folder, its scan.yaml or a transforms.json; and all else a program may give."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from rigs import Rig, load_rig
from rigs.files.size_guard import path_inside
from rigs.files.text import read_yaml_mapping
from rigs.recordings import RawLayout, split_member
from tomo.grid import VoxelGrid, grid_of_rig
from tomo.scan._schema import SCAN_FORMAT, parse_scan_file
from tomo.scan.corrections import Corrections
from tomo.scan.films import Film, Frame, frame_rate_of, frames_of_films, notes_of_films
from tomo.scan.image_folder import frames_in, scan_of_images
from tomo.scan.image_source import MeanImage
from tomo.scan.radiometry import Calibration, Radiometry
from tomo.scan.scan import Scan
from tomo.scan.write import SCAN_FILE, check_cameras

if TYPE_CHECKING:
    from os import PathLike

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
        return _load_scan_yaml(path)
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


def _load_scan_yaml(path: Path) -> Scan:
    """Return the scan of a ``scan.yaml``; errors are a line that names file and field."""
    content = parse_scan_file(path)
    rig = load_rig(_inside(path, content.rig, "rig"))
    films: dict[str, Film] = {}
    if content.images is not None:
        frames = _frames_named(path, content.images, rig)
    elif content.films is not None:
        films = _films_of(path, content.films, rig)
        frames = frames_of_films(films)
    else:
        frames = tuple(_frame(path, one, rig) for one in content.frames or ())
    corrections = _corrections(path, content.corrections.model_dump(), rig)
    grid = grid_of_rig(rig)
    if content.grid is not None:
        with _naming(path):
            grid = VoxelGrid(tuple(content.grid.shape), content.grid.spacing, content.grid.center)
    truth = None if content.truth is None else _inside(path, content.truth, "truth")
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
        frame_rate=content.frame_rate or (frame_rate_of(films) if films else None),
        notes=notes_of_films(films) if films else (),
        radiometry=_radiometry(path, content.radiometry, rig),
        peak=content.peak,
    )


@contextmanager
def _naming(path: Path, field: str = "") -> Iterator[None]:
    """Have an error begin with the file, and with the beginning of the field's name."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{path}: {field}{error}") from None


def _frame(path: Path, entry: Any, rig: Rig) -> Frame:
    where = f"frame {entry.name!r}"
    check_cameras(path, where, entry.images, rig)
    images = {c: _inside(path, text, f"{where}: camera {c}") for c, text in entry.images.items()}
    return Frame(entry.name, images)


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
    with _naming(path):
        found = Corrections(**given).by_camera(rig.names)
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
            _inside(path, str(image.relative_to(path.parent)), field)


def _each(path: Path, content: dict[str, Any], field: str, rig: Rig) -> dict[str, Any]:
    """Return values that are one for all cameras, or one for each, with paths in place of text."""

    def plain(value: Any, where: str) -> Any:
        is_path = isinstance(value, str) and where.split(":")[0] not in _COLOURS
        return _inside(path, value, where) if is_path else value

    found = {}
    for name, value in content.items():
        where = f"{field}.{name}"
        if isinstance(value, dict):
            check_cameras(path, where, value, rig)
            found[name] = {c: plain(one, f"{where}: camera {c}") for c, one in value.items()}
        else:
            found[name] = plain(value, where)
    return found


def _radiometry(path: Path, content: Any, rig: Rig) -> Radiometry | None:
    """Return what a scan.yaml says of absolute light; units that do not fit are refused."""
    if content is None:
        return None
    given = content.model_dump()
    units = {name: given.pop(name) for name in ("unit", "volume_unit")}
    known = _each(path, given.pop("calibration"), "radiometry.calibration", rig)
    rest = _each(path, given, "radiometry", rig)
    with _naming(path, "radiometry."):
        return Radiometry(**units, **rest, calibration=Calibration(**known))


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
    return path_inside(text, scan_file.parent, f"{scan_file}: {field}", "scan")


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
                try:
                    found[camera] = _inside(path, str(text), field)
                except ValueError as error:
                    more = "or images='FOLDER' that has files of that name"
                    raise ValueError(f"{error}, {more}") from None
            else:
                file = found[camera] = _image_in(folder, PurePosixPath(text), field)
                if file in used:
                    raise ValueError(f"{folder}: {field}: found {file} for {used[file]} too, "
                                     f"expected one file an image, as in {text}")  # fmt: skip
                used[file] = f"camera {camera} of frame {name!r}"
        frames.append(Frame(name, found))
    origin = {} if folder is None else {"images": str(folder.absolute())}
    return Scan(rig, tuple(frames), grid=grid_of_rig(rig), source=path, origin=origin)


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


def as_scan(
    given: Scan | str | PathLike | Mapping[str, Any] | Any,
    rig: Rig | str | PathLike | None = None,
    grid: VoxelGrid | None = None,
) -> Scan:
    """Return the scan that is given, loaded from a path, or made of images in memory.

    With ``rig`` a path is a folder of images, a mapping camera to image, see `Scan.from_arrays`.
    """
    if isinstance(given, Scan):
        if rig is not None:
            raise ValueError(f"{given.where}rig: found one, expected none beside a scan's own")
        return given
    settings = {} if grid is None else {"grid": grid}
    if isinstance(given, str | PathLike):
        return load_scan(given) if rig is None else scan_of_images(rig, given, **settings)
    if not (isinstance(given, Mapping) or hasattr(given, "dims")):
        raise ValueError(
            f"scan: found {type(given).__name__}, expected a Scan, a path, or camera to image"
        )
    if rig is None:
        raise ValueError("rig: found none, expected the rig of the images: rig=...")
    if not isinstance(rig, Rig):
        from rigs import load

        rig = load(rig)
    return Scan.from_arrays(rig, given, **settings)


def scan_again(source: Path, origin: Mapping[str, Any]) -> Scan:
    """Return the scan that was loaded from ``source``, a scan or a folder of images, maybe moved.

    ``origin`` is `Scan.origin`: the ``rig`` file of a folder of images and their ``pattern``; the
    folder of ``images`` of a transforms.json; the ``corrections`` that were given.
    """
    if "rig" in origin:
        rig = Path(origin["rig"])
        beside = source.parent / rig.name
        scan = scan_of_images(
            beside if beside.exists() and not rig.exists() else rig, source, origin.get("pattern")
        )
    else:
        scan = load_scan(source, origin.get("images"))
    given = origin.get("corrections")
    return scan.with_corrections(**given) if given else scan
