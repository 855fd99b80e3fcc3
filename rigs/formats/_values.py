"""Values from foreign files, checked; errors are one line.

Formats of one file a camera: a file is a camera, a folder of them a rig.
"""

from __future__ import annotations

import csv
import logging
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import CameraLike
from rigs.files.text import END, check_plain_file, shortened
from rigs.geometry.rotation import rotation
from rigs.recordings import image_size

logger = logging.getLogger(__name__)

_IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".ppm", ".pgm")
RIGID = 1e-4  # deviation from orthonormal, or each other, of rotations stored with few digits


def read_head(path: Path) -> str:
    """Return a file's first characters, by which its format is recognised."""
    check_plain_file(path)
    with path.open("rb") as file:
        return file.read(END).decode("utf-8-sig", "replace").replace("\r\n", "\n")


LARGEST = 1e30
"""Numbers of cameras are below it: their tenth powers, which lenses have, are still finite."""


@contextmanager
def errors_of(where: object) -> Iterator[None]:
    """Put ``where``, a file or a camera, before the one line of a ValueError.

    It is left out where the line begins with it.
    """
    try:
        yield
    except ValueError as error:
        line = str(error).removeprefix(f"{where}: ")
        raise ValueError(" ".join(f"{where}: {line}".split())) from None


@contextmanager
def errors_of_file(path: str | os.PathLike) -> Iterator[None]:
    """Put the file's name before the one line of a ValueError that begins with none of its folder.

    It may begin with a file in ``path``, beside it, or in the folder above, as of a project.
    """
    try:
        yield
    except (ValueError, csv.Error) as error:
        line = " ".join(str(error).split())
        folder = os.path.dirname(path)
        folders = [os.path.join(one, "") for one in (path, folder, os.path.dirname(folder)) if one]
        known = (" ".join(one.split()) for one in (f"{path}: ", *folders))
        is_named = line.startswith(tuple(known))
        raise ValueError(line if is_named else f"{path}: {line}") from None


def as_number(found: Any, what: str) -> float:
    """Return ``found`` as a finite number; YAML 1.1's text ``1e-5`` is accepted too."""
    try:
        number = math.nan if isinstance(found, bool) else float(found)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not abs(number) < LARGEST:  # nor NaN
        raise ValueError(
            f"{what}: found {shortened(found)}, expected a finite number below {LARGEST:g}"
        )
    return number


def as_count(found: object, what: str) -> int:
    """Return ``found`` as a whole number from 1."""
    number = as_number(found, what)
    if number != int(number) or number < 1:
        raise ValueError(f"{what}: found {shortened(found)}, expected a whole number >= 1")
    return int(number)


def as_size(found: object, what: str) -> tuple[int, int]:
    """Return ``found``, two whole numbers from 1, as width and height."""
    width, height = (as_count(n, what) for n in as_array(found, (2,), what).tolist())
    return width, height


def one_of(found: object, known: Iterable[str], what: str) -> str:
    """Return ``found``, one of the ``known`` names."""
    if not isinstance(found, str) or found not in known:
        raise ValueError(f"{what}: found {shortened(found)}, expected one of {', '.join(known)}")
    return found


def as_mapping(found: object, what: str) -> dict[str, Any]:
    """Return ``found``, a mapping."""
    if not isinstance(found, dict):
        raise ValueError(f"{what}: found {shortened(found)}, expected a mapping")
    return found


def usable_name(name: str, path: str | os.PathLike) -> str:
    """Return a camera's name without slashes, which could name no folder; a warning says so."""
    usable = name.replace("/", "_").replace("\\", "_")
    if usable != name:
        logger.warning("%s: camera %s: called %s, as names are without slashes", path,
                       shortened(name), usable)  # fmt: skip
    return usable


def required(values: Mapping[str, Any], key: str, expected: str = "it in the file") -> Any:
    """Return the value of ``key``, which must be there."""
    if key not in values or values[key] is None:
        raise ValueError(f"{key}: missing, expected {expected}")
    return values[key]


def as_array(found: object, shape: tuple[int | None, ...], what: str) -> NDArray[np.float64]:
    """Return ``found`` as finite numbers of ``shape``; None stands for any length, () for all."""
    try:
        array = np.array(found, np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.full((1,) * 9, np.nan)
    fits = not shape or (
        array.ndim == len(shape)
        and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    )
    if not fits or not (np.abs(array) < LARGEST).all():
        wanted = " x ".join(map(str, shape)) + " " if any(shape) else ""
        raise ValueError(f"{what}: found {shortened(found)}, expected {wanted}finite numbers")
    return array


def flat(found: object, what: str) -> NDArray[np.float64]:
    """Return ``found``, numbers in a row, a column or a list, as finite numbers ``(n,)``."""
    return as_array(found, (), what).reshape(-1)


def as_rotation(found: object, what: str) -> NDArray[np.float64]:
    """Return ``found`` as a rotation ``(3, 3)``; it may have few digits."""
    return rotation(as_array(found, (3, 3), what), what, RIGID)


def rotation_of_motion(motion: NDArray[np.float64], what: str) -> NDArray[np.float64]:
    """Return the rotation ``(3, 3)`` of a rigid motion, ``(4, 4)`` or without its last row."""
    if len(motion) == 4 and np.abs(motion[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise ValueError(f"{what}: found last row {motion[3].tolist()}, expected [0, 0, 0, 1]")
    return as_rotation(motion[:3, :3], what)


def numbers_of_line(fields: Sequence[str], names: Sequence[str]) -> list[float]:
    """Return one number a name from the words of a line."""
    if len(fields) != len(names):
        raise ValueError(
            f"found {len(fields)} values, expected {len(names)}: {' '.join(names)[:50]}"
        )
    return [as_number(word, name) for word, name in zip(fields, names, strict=True)]


def cameras_of(
    path: Path,
    files_of: Callable[[Path], list[Path]],
    read: Callable[[Path], CameraLike],
    what: str,
) -> tuple[CameraLike, ...]:
    """Return the camera of a file, or those of a folder."""
    files = files_of(path) if path.is_dir() else [path]
    if not files:
        raise ValueError(f"{path}: found no {what}")
    cameras = []
    for file in files:
        with errors_of_file(file):
            cameras.append(read(file))
    return tuple(cameras)


def image_beside(folders: Iterable[Path], stem: str) -> Path | None:
    """Return the image of that stem in the first of some folders that has one, or None."""
    files = (folder / f"{stem}{suffix}" for folder in folders for suffix in _IMAGES)
    return next((file for file in files if file.is_file()), None)


def image_listed(folder: Path, name: str) -> tuple[PurePosixPath, Path]:
    """Return an image's name in a list and where to look for it: inside the list's folder.

    Lists come from other machines: of a path that is absolute or goes up the last part counts.
    """
    image = PurePosixPath(name.replace("\\", "/"))
    if image.is_absolute() or ".." in image.parts or ":" in name:  # C:/
        image = PurePosixPath(image.name)
    return image, folder / image


def required_size(
    given: tuple[int, int] | None, format_name: str, image: Path | None = None
) -> tuple[int, int]:
    """Return the size given, else that of ``image``; raise if neither is there."""
    size = given
    if size is None and image is not None and image.is_file():
        with suppress(OSError, ValueError):
            size = image_size(image)
    if not size:
        source = f", or the image {image} in the file's folder" if image else ""
        raise ValueError(
            f"image_size: missing, as {format_name} files hold none, "
            f"expected convert-rig's --image-size WIDTHxHEIGHT{source}"
        )
    return size
