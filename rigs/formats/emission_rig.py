"""The project's own ``rig.yaml`` as one of the formats."""

from __future__ import annotations

import re
from pathlib import Path

from rigs.files import load_rig, save_rig
from rigs.rig import Rig


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file has the format's name, or a list of cameras like it."""
    says = re.search(r"^format\s*:\s*['\"]?emission.?rig", head, re.MULTILINE | re.IGNORECASE)
    lists = re.search(r"^cameras\s*:\s*(#.*)?\n\s*-\s", head, re.MULTILINE)
    return bool(says or (lists and not head.startswith("%YAML")))


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``rig.yaml``: see `rigs.load_rig`."""
    return load_rig(path)


def save(rig: Rig, path: Path) -> None:
    """Write a ``rig.yaml``: see `rigs.save_rig`."""
    save_rig(rig, path)
