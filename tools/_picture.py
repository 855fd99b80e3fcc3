"""What the commands that draw share: which files they can write."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from _command import check_output_folder

SUFFIXES = (".png", ".html", ".glb")


def check_outputs(paths: Iterable[Path]) -> None:
    """Raise unless every path has a suffix that can be written."""
    for path in paths:
        if path.suffix.lower() not in SUFFIXES:
            raise ValueError(
                f"{path}: suffix: found {path.suffix!r}, expected one of {', '.join(SUFFIXES)}"
            )
        if path.is_dir():
            raise IsADirectoryError(f"{path}: is a folder, expected a file to write")
        check_output_folder(path.parent)
