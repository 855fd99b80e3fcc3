"""Checks of the files and folders to write, made before the work rather than after it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tomo.draw.suffixes import PICTURE_SUFFIXES

if TYPE_CHECKING:
    from rigs import Rig


def check_output_folder(folder: Path) -> None:
    """Raise unless the folder exists or can be made; remove what killed runs left in it."""
    existing = folder.absolute()
    while not existing.exists():
        existing = existing.parent
    if not existing.is_dir():
        raise NotADirectoryError(f"{existing}: is a file, expected a folder to write into")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise PermissionError(f"{existing}: nothing can be written there")
    if folder.exists():
        from rigs.files import remove_leftovers

        remove_leftovers(folder)


def check_output_file(path: Path, suffixes: Sequence[str] = ()) -> None:
    """Raise unless a file of one of the suffixes, if any are named, can be written there."""
    if suffixes and path.suffix.lower() not in suffixes:
        expected = suffixes[0] if len(suffixes) == 1 else f"one of {', '.join(suffixes)}"
        raise ValueError(f"{path}: suffix: found {path.suffix!r}, expected {expected}")
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a folder, expected a file to write")
    check_output_folder(path.parent)


def check_output_pictures(paths: Iterable[Path], *more: str) -> None:
    """Raise unless every path is that of a picture that can be written."""
    for path in paths:
        check_output_file(path, (*PICTURE_SUFFIXES, *more))


def check_output_volume(folder: Path, rig: Rig, source: object) -> None:
    """Raise unless volumes in the unit of a rig from ``source`` can be written into the folder."""
    from tomo.io.volumes import check_length_unit

    check_output_folder(folder)
    try:
        check_length_unit(rig.length_unit)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
