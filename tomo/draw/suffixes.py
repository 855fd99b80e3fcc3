"""The files that pictures are written to, by their suffix."""

from __future__ import annotations

import os
from pathlib import Path

FIGURE_SUFFIXES = (".png", ".pdf", ".svg")
"""The suffixes of flat pictures; text and lines of the last two can be enlarged."""

PICTURE_SUFFIXES = (*FIGURE_SUFFIXES, ".html", ".glb")
TURNING = ".gif"
"""The suffix of a volume that turns; rigs are not drawn so."""


def suffix_of(path: str | os.PathLike, *more: str) -> str:
    """Return the suffix of a picture's file in small letters.

    Raises
    ------
    ValueError
        If it is none of `PICTURE_SUFFIXES` and of ``more``.
    """
    suffix, known = Path(path).suffix, (*PICTURE_SUFFIXES, *more)
    if suffix.lower() not in known:
        expected = ", ".join(known)
        raise ValueError(f"{path}: suffix: found {suffix!r}, expected one of {expected}")
    return suffix.lower()
