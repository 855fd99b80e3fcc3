"""NeRF-style ``transforms.json``, as nerfstudio and instant-ngp write it.

There, camera axes are OpenGL's (x right, y up, z backward), matrices are camera-to-world, and
(0.5, 0.5) is the centre of the top-left pixel.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from rigs._text import read_text
from rigs.camera import Camera
from rigs.formats._entry import entry_camera, shortened
from rigs.rig import Rig

logger = logging.getLogger(__name__)

Frames = list[tuple[str, dict[str, Path]]]

_SCALE_KEYS = ("scale", "offset", "applied_scale", "applied_transform")


def load_transforms(path: str | os.PathLike) -> tuple[Rig, Frames]:
    """Return the rig and the images of a ``transforms.json``.

    Parameters
    ----------
    path : path
        Intrinsics may stand once for all or in each entry, which wins.

    Returns
    -------
    rig : Rig
        Cameras in order of appearance, ``calibrated``. The file names no unit, so
        ``length_unit`` is ``unit``, unless it holds one.
    frames : list of (str, {camera name: Path})
        In order of appearance; images are not opened, nor need they exist.

    Raises
    ------
    FileNotFoundError, IsADirectoryError
        If there is no such file.
    ValueError
        In one line: the file, the entry's image, the field, what was found, what was expected.

    Notes
    -----
    An entry's camera is its ``camera``, else its image's folder, else the entry itself, named
    by its image's stem; the frame is the image's stem. The folder of *all* images names no
    camera if their cameras differ: then each entry is a camera, and all are of one frame,
    which is named like the file.
    """
    path = Path(path)
    data = _read_json(path)
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
            image = _image_path(entry, path.parent)
            cameras.append(entry_camera(entry, data))
        except ValueError as error:
            name = entry.get("file_path") if isinstance(entry, dict) else None
            where = f"frames[{index}]" + (f" ({name})" if isinstance(name, str) else "")
            raise ValueError(f"{path}: {' '.join(f'{where}: {error}'.split())}") from None
        images.append(image)
    try:
        names, frame_names = _names(entries, images, cameras, path.stem)
        return _grouped(path.parent, images, cameras, names, frame_names, data)
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


def _read_json(path: Path) -> dict[str, Any]:
    """Return the mapping in a JSON file."""
    text = read_text(path)
    if not text.strip():
        raise ValueError(f"{path}: found an empty file, expected JSON")
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}: broken JSON at line {error.lineno}: {error.msg}") from None
    except RecursionError:
        raise ValueError(f"{path}: broken JSON: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{path}: broken JSON: {error}") from None
    if not isinstance(data, dict):
        raise ValueError(f"{path}: found {type(data).__name__}, expected a JSON object")
    return data


def _image_path(entry: Mapping[str, Any], folder: Path) -> PurePosixPath:
    """Return an entry's image relative to ``folder``, or raise if it leaves it."""
    found = entry.get("file_path")
    if not isinstance(found, str) or not found.strip() or "\0" in found:
        raise ValueError(f"file_path: found {shortened(found)}, expected an image's path")
    relative = os.path.normpath(found.replace("\\", "/"))
    is_inside = not os.path.isabs(relative) and relative.split("/")[0] not in ("..", ".")
    try:
        is_inside = is_inside and (folder / relative).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):
        is_inside = False
    if not is_inside:
        raise ValueError(f"file_path: found {shortened(found)}, expected a path inside the folder")
    return PurePosixPath(relative)


def _names(
    entries: list[dict], images: list[PurePosixPath], cameras: list[Camera], file_stem: str
) -> tuple[list[str], list[str]]:
    """Return each entry's camera name and frame name."""
    unnamed = [i for i, entry in enumerate(entries) if "camera" not in entry]
    folders = {images[i].parent for i in unnamed}
    alone = len(folders) == 1 and any(not _agree(cameras[i], cameras[unnamed[0]]) for i in unnamed)
    names, frame_names = [], []
    for index, (entry, image) in enumerate(zip(entries, images, strict=True)):
        if "camera" in entry:
            if not isinstance(entry["camera"], str):
                raise ValueError(
                    f"frames[{index}]: camera: found {shortened(entry['camera'])}, expected text"
                )
            names.append(entry["camera"])
            frame_names.append(image.stem)
        elif alone or not image.parent.name:
            names.append(image.stem)
            frame_names.append(file_stem)
        else:
            names.append(_folder_name(image.parent, folders))
            frame_names.append(image.stem)
    return names, frame_names


def _folder_name(folder: PurePosixPath, folders: set[PurePosixPath]) -> str:
    """Return a folder's last part, or all of them where another folder ends the same."""
    alike = [other for other in folders if other.name == folder.name]
    return folder.name if len(alike) == 1 else "_".join(folder.parts)


def _grouped(
    folder: Path,
    images: list[PurePosixPath],
    cameras: list[Camera],
    names: list[str],
    frame_names: list[str],
    data: Mapping[str, Any],
) -> tuple[Rig, Frames]:
    """Return the rig of the different cameras and the images by frame and camera."""
    by_name: dict[str, tuple[Camera, PurePosixPath]] = {}
    frames: dict[str, dict[str, Path]] = {}
    for image, camera, name, frame in zip(images, cameras, names, frame_names, strict=True):
        first, first_image = by_name.setdefault(name, (camera, image))
        field = _difference(camera, first)
        if field:
            raise ValueError(
                f"camera {name}: {field}: differs between {first_image} and {image}, "
                "expected the same in all its entries"
            )
        views = frames.setdefault(frame, {})
        if name in views:
            raise ValueError(f"camera {name}: frame {frame}: found twice, expected one image")
        views[name] = folder / image
    unit = data.get("length_unit", "unit")
    if not isinstance(unit, str):
        raise ValueError(f"length_unit: found {shortened(unit)}, expected text")
    renamed = [replace(camera, name=name) for name, (camera, _) in by_name.items()]
    return Rig(tuple(renamed), unit, "as in transforms.json"), list(frames.items())


def _difference(camera: Camera, other: Camera) -> str:
    """Return the name of the first field in which two cameras differ, or nothing."""
    if camera.image_size != other.image_size:
        return "w, h"
    if camera.distortion != other.distortion:
        return "distortion"
    for field, name in (
        ("camera_matrix", "fl_x, fl_y, cx, cy"),
        ("R", "transform_matrix"),
        ("t", "transform_matrix"),
    ):
        if not np.allclose(getattr(camera, field), getattr(other, field), rtol=1e-9, atol=1e-12):
            return name
    return ""


def _agree(camera: Camera, other: Camera) -> bool:
    """Say whether two entries' cameras are one."""
    return not _difference(camera, other)


def _is_neutral(value: object) -> bool:
    """Say whether a scale or transform changes nothing."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        return False
    if array.shape in ((3, 4), (4, 4)):
        return bool((array == np.eye(4)[: len(array)]).all())
    return bool((array == (1.0 if array.ndim == 0 else 0.0)).all())
