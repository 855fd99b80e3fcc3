"""What the commands that draw share: which files they can write."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from _command import check_output_file

SUFFIXES = (".png", ".html", ".glb")


def check_outputs(paths: Iterable[Path]) -> None:
    """Raise unless every path has a suffix that can be written."""
    for path in paths:
        check_output_file(path, SUFFIXES)
