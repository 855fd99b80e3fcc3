"""A rig by any name that a person gives it: a preset, or a file or folder of any format."""

from __future__ import annotations

import os
from pathlib import Path

from rigs.files.rig_yaml import preset, preset_names
from rigs.formats import registry
from rigs.rig import Rig

_INSIDE = ("transforms.json", "rig.yaml")  # files that make a folder a rig's


def load(
    source: str | os.PathLike,
    format: str | None = None,
    *,
    length_unit: str | None = None,
    image_size: tuple[int, int] | None = None,
) -> Rig:
    """Return a rig by a preset's name, or in a file or folder of any format.

    Parameters
    ----------
    source : str or path-like
        One of `rigs.preset_names`, or a path: a rig.yaml, a scan's folder, or what
        `rigs.formats.names` lists.
    format : str, optional
        One of these; by default it is recognised by the content.
    length_unit, image_size
        See `rigs.formats.load`.

    Raises
    ------
    FileNotFoundError
        If there is neither; the line names the presets.
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.

    Examples
    --------
    >>> len(load("paper11_22deg"))
    11
    """
    path = Path(source)
    if str(source) in preset_names():
        return preset(str(source))
    if not path.exists():
        known = ", ".join(preset_names())
        raise FileNotFoundError(f"{source}: no such rig file, and no preset; presets are {known}")
    files = [path / name for name in _INSIDE if (path / name).is_file()]
    chosen = files[0] if files else path
    return registry.load(chosen, format, length_unit=length_unit, image_size=image_size)
