"""Scans on disk, a folder, its scan.yaml or a transforms.json; and all else a program may give."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from rigs import Rig
from rigs.files.text import read_yaml_mapping
from tomo.grid import VoxelGrid, grid_of_rig
from tomo.scan._schema import SCAN_FORMAT
from tomo.scan.image_folder import scan_of_images
from tomo.scan.image_source import Frame
from tomo.scan.scan import Scan
from tomo.scan.scan_yaml import inside_scan, load_scan_yaml
from tomo.scan.write import SCAN_FILE

if TYPE_CHECKING:
    from os import PathLike


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
        return load_scan_yaml(path)
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
    origin = {} if folder is None else {"images": str(folder.absolute())}
    return Scan(rig, tuple(frames), grid=grid_of_rig(rig), source=path, origin=origin)


def _image_inside(path: Path, text: str, field: str) -> Path:
    """Return the image that a ``transforms.json`` names in its folder."""
    try:
        return inside_scan(path, text, field)
    except ValueError as error:
        raise ValueError(f"{error}, or images='FOLDER' that has files of that name") from None


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
