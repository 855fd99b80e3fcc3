"""The coefficients of `rigs.formats.dlt` by Argus and DLTdv 3 to 7: from the bottom.

Read only. The centre of the bottom-left pixel is (1, 1), and v points up. A file does not say so:
this format is chosen by its name.
"""

from __future__ import annotations

from pathlib import Path

from rigs.formats.dlt import load_counted
from rigs.rig import Rig


def looks_like(path: Path, head: str) -> bool:
    """Return False: such files are recognised as `rigs.formats.dlt`."""
    return False


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a table, as `rigs.formats.dlt.load` does."""
    return load_counted(Path(path), image_size, first=1, bottom=True)
