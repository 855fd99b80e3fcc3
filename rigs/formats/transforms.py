"""NeRF-style ``transforms.json``, as nerfstudio and instant-ngp write it.

There, camera axes are OpenGL's (x right, y up, z backward), matrices are camera-to-world, and
(0.5, 0.5) is the centre of the top-left pixel.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from rigs.camera import Camera
from rigs.files.text import breaks_a_line, read_json, shortened, write_text
from rigs.files.units import UNKNOWN
from rigs.formats._entry import camera_entry, entry_camera
from rigs.formats._lens import refuse_tables
from rigs.formats._values import errors_of_file
from rigs.formats._views import Frames, grouped, named
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_SCALE_KEYS = ("scale", "offset", "applied_scale", "applied_transform")


def load_transforms(
    path: str | os.PathLike, image_size: tuple[int, int] | None = None
) -> tuple[Rig, Frames]:
    """Return the rig and the images of a ``transforms.json``.

    Parameters
    ----------
    path : path
        Intrinsics are given once for all or in each entry, which takes precedence.
    image_size : (int, int), optional
        Width and height in pixels where the file holds none, as for rendered scenes.

    Returns
    -------
    rig : Rig
        Cameras in order of appearance, ``calibrated``; its ``length_unit`` is ``unit``, unless the
        file holds one.
    frames : list of (str, {camera name: Path})
        In order of appearance; images are not opened, nor need they exist. A path that is
        absolute, of Windows, or leads out of the file's folder is kept as it is: who opens an
        image checks it.

    Notes
    -----
    An entry's camera is its ``camera``, else as in `rigs.formats._views.named`; so is its frame.
    """
    path = Path(path)
    data = read_json(path)
    if isinstance(data, list):
        data = {"frames": data}
    if not isinstance(data, dict):
        raise ValueError(f"{path}: found {shortened(data)}, expected a JSON object")
    if image_size is not None:
        data = {"w": image_size[0], "h": image_size[1], **data}
    entries = data.get("frames")
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"{path}: frames: found {shortened(entries)}, expected a list of entries")
    for key in _SCALE_KEYS:
        if key in data and not _is_neutral(data[key]):
            logger.warning("%s: %s: found %s: not applied", path, key, shortened(data[key]))
    cameras: list[Camera] = []
    images: list[PurePosixPath] = []
    for index, entry in enumerate(entries):
        try:
            if not isinstance(entry, dict):
                raise ValueError(f"found {shortened(entry)}, expected a mapping")
            image = _image_path(entry)
            cameras.append(entry_camera(entry, data))
        except ValueError as error:
            name = entry.get("file_path") if isinstance(entry, dict) else None
            where = f"frames[{index}]" + (f" ({name})" if isinstance(name, str) else "")
            raise ValueError(f"{path}: {' '.join(f'{where}: {error}'.split())}") from None
        images.append(image)
    with errors_of_file(path):
        given = [_camera_name(index, entry) for index, entry in enumerate(entries)]
        inner = [_without_root(image) for image in images]
        names, frame_names = named(inner, cameras, given, path.stem)
        found, frames = grouped(path.parent, images, cameras, names, frame_names)
        unit = data.get("length_unit", UNKNOWN)
        if not isinstance(unit, str):
            raise ValueError(f"length_unit: found {shortened(unit)}, expected text")
        return Rig(tuple(found), unit, "as in transforms.json"), frames


def save_transforms(rig: Rig, path: str | os.PathLike, frames: Frames | None = None) -> None:
    """Write a ``transforms.json`` of ``frames``, by default one of ``images/<camera>.png``.

    instant-ngp reads k1, k2, p1, p2 of a lens, and fisheyes; other coefficients it ignores.
    A rational lens is FULL_OPENCV here, as in COLMAP; nerfstudio refuses it.
    """
    path = Path(path)
    cameras = refuse_tables(rig, "transforms.json")
    entries = {camera.name: camera_entry(camera) for camera in cameras}
    if frames is None:
        views = [(name, PurePosixPath("images", f"{name}.png")) for name in rig.names]
    else:
        views = [
            (rig[name].name, _relative(image, path.parent))
            for _, images in frames
            for name, image in images.items()
        ]
    data = {
        "length_unit": rig.length_unit,
        "frames": [
            {"file_path": str(image), "camera": name, **entries[name]} for name, image in views
        ],
    }
    models = {entry["camera_model"] for entry in entries.values()}
    if len(models) == 1:  # nerfstudio expects the model at the top level
        data = {"camera_model": models.pop(), **data}
    write_text(path, json.dumps(data, indent=2, ensure_ascii=False) + "\n")


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file holds frames with camera-to-world matrices."""
    keys = '"transform_matrix"' in head and (
        '"frames"' in head or (head.lstrip().startswith("[") and '"file_path"' in head)
    )
    return path.name == "transforms.json" or (path.suffix == ".json" and keys)


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig alone of a ``transforms.json``: see `load_transforms`."""
    return load_transforms(path, image_size)[0]


def save(rig: Rig, path: Path) -> None:
    """Write a ``transforms.json`` of one frame: see `save_transforms`."""
    save_transforms(rig, path)


def _camera_name(index: int, entry: Mapping[str, Any]) -> str | None:
    """Return the name that an entry gives its camera, if it does."""
    name = entry.get("camera")
    if "camera" in entry and not isinstance(name, str):
        raise ValueError(f"frames[{index}]: camera: found {shortened(name)}, expected text")
    return name


def _relative(image: Path, folder: Path) -> PurePosixPath:
    """Return an image's path from ``folder``."""
    try:
        return PurePosixPath(Path(image).relative_to(folder))
    except ValueError:
        raise ValueError(f"file_path: found {image}, expected a path inside {folder}") from None


def _image_path(entry: Mapping[str, Any]) -> PurePosixPath:
    """Return an entry's image as the file names it, from its folder; it may lead out of it."""
    found = entry.get("file_path")
    if not isinstance(found, str) or not found.strip() or "\0" in found or breaks_a_line(found):
        raise ValueError(f"file_path: found {shortened(found)}, expected an image's path")
    path = os.path.normpath(found.replace("\\", "/"))
    if path == ".":
        raise ValueError(f"file_path: found {shortened(found)}, expected an image's path")
    return PurePosixPath(path)


def _without_root(image: PurePosixPath) -> PurePosixPath:
    """Return the part of a path that names folders and the image."""
    parts = image.parts[:-1]
    return PurePosixPath(*(p for p in parts if p not in ("/", "..") and ":" not in p), image.name)


def _is_neutral(value: object) -> bool:
    """Return whether a scale or transform changes nothing."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        return False
    if array.shape in ((3, 4), (4, 4)):
        return bool((array == np.eye(4)[: len(array)]).all())
    return bool((array == (1.0 if array.ndim == 0 else 0.0)).all())
