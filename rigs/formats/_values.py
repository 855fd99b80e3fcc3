"""Values from foreign files, checked; errors are one line."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import check_plain_file, shortened
from rigs.geometry.rotation import rotation

logger = logging.getLogger(__name__)

_HEAD = 65536  # bytes
RIGID = 1e-4  # deviation from orthonormal, or each other, of rotations stored with few digits


def read_head(path: Path) -> str:
    """Return a file's first characters, by which its format is recognised."""
    check_plain_file(path)
    with path.open("rb") as file:
        return file.read(_HEAD).decode("utf-8-sig", "replace").replace("\r\n", "\n")


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
    except ValueError as error:
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
    """Return ``found`` as finite numbers of ``shape``; None stands for any length."""
    try:
        array = np.array(found, np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros((0,) * 9)
    fits = array.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits or not (np.abs(array) < LARGEST).all():
        wanted = "" if shape == (None,) else " x ".join(map(str, shape)) + " "
        raise ValueError(f"{what}: found {shortened(found)}, expected {wanted}finite numbers")
    return array


def flat(found: object, what: str) -> NDArray[np.float64]:
    """Return ``found``, numbers in a row, a column or a list, as finite numbers ``(n,)``."""
    try:
        array = np.array(found, np.float64).reshape(-1)
    except (TypeError, ValueError, OverflowError):
        array = np.array([np.nan])
    if not (np.abs(array) < LARGEST).all():
        raise ValueError(f"{what}: found {shortened(found)}, expected finite numbers")
    return array


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
            f"found {len(fields)} values, expected {len(names)}: {' '.join(names)[:60]}"
        )
    return [as_number(word, name) for word, name in zip(fields, names, strict=True)]
