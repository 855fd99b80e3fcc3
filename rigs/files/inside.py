"""Paths that files name: they may not leave the folder."""

from __future__ import annotations

from pathlib import Path

from rigs.files.text import breaks_a_line, shortened


def path_inside(file: str, folder: Path, where: str) -> Path:
    """Return the path of a file that a rig's file names, or raise if it leaves the folder.

    Parameters
    ----------
    file : str
        Relative to ``folder``.
    folder : Path
    where : str
        Begins the message: what names the file.

    Raises
    ------
    ValueError
        If the path is absolute, leaves the folder, also by a link, or is no path.
    """
    message = f"{where}: found {shortened(file)}, expected a path inside the rig's folder"
    if not file.strip() or "\0" in file or breaks_a_line(file) or Path(file).is_absolute():
        raise ValueError(message)
    path = folder / file.replace("\\", "/")
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):
        inside = False
    if not inside:
        raise ValueError(message)
    return path
