"""Paths that files name: they may not leave the folder."""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

from rigs.files.text import breaks_a_line, shortened


def path_inside(file: str, folder: Path, where: str, owner: str = "rig's") -> Path:
    """Return the path of a file that a file in ``folder`` names, or raise if it leaves the folder.

    Parameters
    ----------
    file : str
        Relative to ``folder``; with the slashes of any system.
    folder : Path
    where : str
        Begins the message: what names the file.
    owner : str
        Whose folder it is, for the message.

    Raises
    ------
    ValueError
        If the path is absolute on any system, leaves the folder, also by a link, or is no path.
    """
    is_path = bool(file.strip()) and not breaks_a_line(file) and not PureWindowsPath(file).anchor
    path = folder / file.replace("\\", "/")
    try:
        # a name that no file system can hold raises in exists
        path.exists()
        is_inside = is_path and path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        is_inside = False
    if not is_inside:
        raise ValueError(
            f"{where}: found {shortened(file)}, expected a path inside the {owner} folder"
        )
    return path
