"""Values that a header keeps in a file beside it."""

from __future__ import annotations

from pathlib import Path

from rigs.files.inside import path_inside


def content_beside(header: Path, name: object, field: str) -> bytes:
    """Return the content of the file that a field of a header names.

    Raises
    ------
    ValueError
        If it names a list or a series of files, leaves the header's folder, or is not there.
    """
    text = name if isinstance(name, str) else ""
    if not text or text.upper().startswith("LIST") or "%" in text:
        raise ValueError(f"{field}: found {str(name)[:60]!r}, expected the name of one file")
    path = path_inside(text, header.parent, field, "header's")
    if not path.is_file():
        raise ValueError(f"{field}: found no file {path.name} beside it, expected the values")
    return path.read_bytes()
