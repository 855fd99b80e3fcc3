"""What the commands that draw share: which rigs they take, and which files they can write."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from _command import check_output_file, load_rig_or_preset

if TYPE_CHECKING:
    from rigs import Rig

SUFFIXES = (".png", ".html", ".glb")


def check_outputs(paths: Iterable[Path]) -> None:
    """Raise unless every path has a suffix that can be written."""
    for path in paths:
        check_output_file(path, SUFFIXES)


def load_any_rig(text: str) -> Rig:
    """Return the rig of a preset, a scan's folder, or a file or folder of any known format."""
    path = Path(text)
    for name in ("transforms.json", "rig.yaml"):  # of a scan
        if (path / name).is_file():
            return load_rig_or_preset(str(path / name))
    return load_rig_or_preset(text)
