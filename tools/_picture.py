"""What the commands that draw share: which rigs they take, and which files they can write."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from _command import check_output_folder, load_rig_or_preset

if TYPE_CHECKING:
    from rigs import Rig

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


def load_any_rig(text: str) -> Rig:
    """Return the rig of a preset, a scan's folder, or a file or folder of any known format."""
    path = Path(text)
    for name in ("transforms.json", "rig.yaml"):  # of a scan
        if (path / name).is_file():
            return load_rig_or_preset(str(path / name))
    return load_rig_or_preset(text)
