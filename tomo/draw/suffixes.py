"""The files that pictures are written to, by their suffix."""

from __future__ import annotations

import os
from pathlib import Path

PICTURE_SUFFIXES = (".png", ".html", ".glb")


def suffix_of(path: str | os.PathLike) -> str:
    """Return the suffix of a picture's file in small letters.

    Raises
    ------
    ValueError
        If it is none of `PICTURE_SUFFIXES`.
    """
    suffix = Path(path).suffix
    if suffix.lower() not in PICTURE_SUFFIXES:
        expected = ", ".join(PICTURE_SUFFIXES)
        raise ValueError(f"{path}: suffix: found {suffix!r}, expected one of {expected}")
    return suffix.lower()
