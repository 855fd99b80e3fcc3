"""Scans on disk: scan.yaml, transforms.json, and a rig beside a folder of images."""

from __future__ import annotations

import os
import reprlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

from rigs import Rig, formats, load_rig, save_rig
from rigs.files import whole_folder
from rigs.files.text import breaks_a_line
from rigs.recordings import SCAN_SUFFIXES, write_image
from tomo.grid import VoxelGrid, grid_of_rig
from tomo.io import write_volume
from tomo.io.volumes import check_length_unit
from tomo.scan._schema import parse_scan_file
from tomo.scan.corrections import Corrections
from tomo.scan.scan import Frame, Scan

if TYPE_CHECKING:
    from os import PathLike

SCAN_FILE = "scan.yaml"


def load_scan(path: str | PathLike) -> Scan:
    """Load a scan folder, its ``scan.yaml``, or a NeRF-style ``transforms.json``.

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
        return _load_transforms(path)
    if path.suffix.lower() in (".yaml", ".yml"):
        return _load_scan_file(path)
    raise ValueError(
        f"{path}: scan: found suffix {path.suffix!r}, expected a folder, .yaml or .json"
    )


def _load_transforms(path: Path) -> Scan:
    from rigs.formats.transforms import load_transforms

    rig, frames = load_transforms(path)
    for name, images in frames:
        for camera, image in images.items():
            if not Path(image).resolve().is_relative_to(path.parent.resolve()):
                raise ValueError(
                    f"{path}: frame {name!r}: camera {camera}: found the path {image}, "
                    "expected one inside the folder of the file"
                )
    return Scan(
        rig, tuple(Frame(n, dict(i)) for n, i in frames), grid=grid_of_rig(rig), source=path
    )


def _load_scan_file(path: Path) -> Scan:
    content = parse_scan_file(path)
    rig = load_rig(_inside(path, content.rig, "rig"))
    for frame in content.frames:
        _check_cameras(path, f"frame {frame.name!r}", frame.images, rig)
    frames = tuple(
        Frame(
            frame.name,
            {
                camera: _inside(path, image, f"frame {frame.name!r}: camera {camera}")
                for camera, image in frame.images.items()
            },
        )
        for frame in content.frames
    )
    corrections = {}
    for name, value in content.corrections.model_dump().items():
        if isinstance(value, dict):
            _check_cameras(path, f"corrections.{name}", value, rig)
            corrections[name] = {
                camera: _path_or_number(path, one, f"corrections.{name}: camera {camera}")
                for camera, one in value.items()
            }
        else:
            corrections[name] = _path_or_number(path, value, f"corrections.{name}")
    grid = grid_of_rig(rig)
    if content.grid is not None:
        try:
            grid = VoxelGrid(tuple(content.grid.shape), content.grid.spacing, content.grid.center)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
    truth = None if content.truth is None else _inside(path, content.truth, "truth")
    effects = None if content.effects is None else content.effects.model_dump()
    if effects is not None:
        _check_cameras(path, "effects.gains", effects["gains"], rig)
    return Scan(rig, frames, Corrections(**corrections), grid, truth, source=path, effects=effects)


def _inside(scan_file: Path, text: str, field: str) -> Path:
    """Return the path that a file names, refusing any that leaves the file's folder."""
    folder = scan_file.parent
    posix, windows = PurePosixPath(text), PureWindowsPath(text)
    leaves = posix.is_absolute() or windows.drive or windows.root
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


def _path_or_number(scan_file: Path, value: Any, field: str) -> Any:
    return _inside(scan_file, value, field) if isinstance(value, str) else value


def _check_cameras(path: Path, field: str, cameras: Mapping[str, Any], rig: Rig) -> None:
    for camera in cameras:
        if camera not in rig.names:
            known = ", ".join(rig.names)
            raise ValueError(
                f"{path}: {field}: found camera {camera!r}, expected one of the rig's: {known}"
            )


def scan_of_images(rig: Rig | str | PathLike, images: str | PathLike, **settings: Any) -> Scan:
    """Return the scan of a rig (or a rig file) and a folder ``images/<camera>/<frame>.*``.

    ``settings`` are further fields of Scan: ``corrections``, ``grid``.

    Raises
    ------
    ValueError
        If a camera has no folder, or two images of a camera share one frame name.
    """
    rig = rig if isinstance(rig, Rig) else formats.load(rig)
    folder = Path(images)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder of images")
    frames: dict[str, dict[str, Path]] = {}
    for camera in rig.names:
        if not (folder / camera).is_dir():
            others = ", ".join(sorted(path.name for path in folder.iterdir() if path.is_dir()))
            raise FileNotFoundError(
                f"{folder}: camera {camera}: found no folder {camera} in it, expected one for "
                f"every camera of the rig; it has {others or 'no folders'}"
            )
        for image in sorted((folder / camera).iterdir()):
            if image.suffix.lower() not in SCAN_SUFFIXES or image.name.startswith("."):
                continue
            of_frame = frames.setdefault(image.stem, {})
            if camera in of_frame:
                raise ValueError(
                    f"{image}: camera {camera}: found frame {image.stem!r} twice, expected once: "
                    f"the other is {of_frame[camera].name}"
                )
            of_frame[camera] = image
        if not any(camera in of_frame for of_frame in frames.values()):
            raise ValueError(
                f"{folder / camera}: camera {camera}: found no image, expected files that end in "
                f"{', '.join(SCAN_SUFFIXES)}"
            )
    settings.setdefault("grid", grid_of_rig(rig))
    ordered = tuple(Frame(name, frames[name]) for name in sorted(frames))
    return Scan(rig, ordered, source=folder, **settings)


def save_scan(
    folder: str | PathLike,
    rig: Rig,
    frames: Mapping[str, Mapping[str, ArrayLike]],
    *,
    grid: VoxelGrid | None = None,
    truth: ArrayLike | None = None,
    corrections: Corrections | None = None,
    effects: Mapping[str, Any] | None = None,
) -> Path:
    """Write a scan folder: ``rig.yaml``, ``images/<camera>/<frame>.tif``, ``scan.yaml``.

    Until all is written, the folder keeps what stood there before: see `rigs.files.whole_folder`.

    Parameters
    ----------
    folder : path-like
    rig : Rig
    frames : mapping
        Frame name to a mapping from camera name to image ``(h, w)``.
    grid : VoxelGrid, optional
    truth : (nx, ny, nz) array, optional
        The true volume on ``grid``; stored as ``truth.npz``.
    corrections : Corrections, optional
        Its image paths must lie inside ``folder``.
    effects : mapping, optional
        What the images were simulated with, see `Scan`.

    Returns
    -------
    scan_file : Path

    Raises
    ------
    ValueError
        If a name cannot be a file's, an image is not of its camera's size, or a truth has no grid.
    """
    folder = Path(folder)
    if truth is not None and grid is None:
        raise ValueError(f"{folder}: truth: found no grid, expected the one that it lies on")
    if truth is not None:
        check_length_unit(rig.length_unit)
    for frame, images in frames.items():
        for camera, image in images.items():
            _check_image(folder, frame, camera, np.shape(image), rig)
    content: dict[str, Any] = {"format": "emission-scan", "version": 1, "rig": "rig.yaml"}
    if grid is not None:
        content["grid"] = {
            "shape": list(grid.shape),
            "spacing": list(grid.spacing),
            "center": list(grid.center),
        }
    content["frames"] = [
        {"name": frame, "images": {camera: f"images/{camera}/{frame}.tif" for camera in images}}
        for frame, images in frames.items()
    ]
    if corrections is not None:
        content["corrections"] = _plain_corrections(folder, corrections)
    if truth is not None:
        content["truth"] = "truth.npz"
    if effects is not None:
        content["effects"] = {name: value for name, value in effects.items() if value is not None}

    with whole_folder(folder, last=(SCAN_FILE,)) as staging:
        save_rig(rig, staging / "rig.yaml")
        for frame, images in frames.items():
            for camera, image in images.items():
                write_image(staging / "images" / camera / f"{frame}.tif", image)
        if truth is not None:
            write_volume(staging / "truth.npz", truth, grid, rig.length_unit)
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
        (staging / SCAN_FILE).write_text(text, encoding="utf-8")
    return folder / SCAN_FILE


def _check_image(folder: Path, frame: str, camera: str, shape: tuple, rig: Rig) -> None:
    _check_cameras(folder, f"frame {frame!r}", [camera], rig)
    for name in (frame, camera):
        if not name or name.startswith(".") or set(name) & set('/\\:*?"<>|\0'):
            raise ValueError(f"{folder}: found the name {name!r}, expected one fit for a file")
    width, height = rig[camera].image_size
    if shape != (height, width):
        raise ValueError(
            f"{folder}: frame {frame!r}: camera {camera}: found an image of shape {shape}, "
            f"expected {(height, width)}"
        )


def _plain_corrections(folder: Path, corrections: Corrections) -> dict[str, Any]:
    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {camera: plain(one) for camera, one in value.items()}
        return os.path.relpath(value, folder) if isinstance(value, Path) else value

    given = {name: plain(getattr(corrections, name)) for name in Corrections.__dataclass_fields__}
    return {name: value for name, value in given.items() if value is not None}
