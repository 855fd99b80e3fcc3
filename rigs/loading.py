"""A rig by any name that a person gives it: a preset, or a file or folder of any format."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path
from typing import Any

from rigs.files.rig_yaml import load_rig
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
    format, length_unit, image_size
        See `rigs.formats.load`.

    Raises
    ------
    FileNotFoundError, ValueError
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
    if len(files) > 1:
        raise ValueError(f"{path}: found {' and '.join(_INSIDE)}, expected one of them: name it")
    chosen = files[0] if files and format is None else path
    return registry.load(chosen, format, length_unit=length_unit, image_size=image_size)


def preset_names() -> tuple[str, ...]:
    """Return the names of the rigs that come with the package."""
    return tuple(sorted(file.name.removesuffix(".yaml") for file in _preset_files()))


def preset(name: str) -> Rig:
    """Return the rig called ``name`` of those that come with the package."""
    for file in _preset_files():
        if file.name == f"{name}.yaml":
            with resources.as_file(file) as path:
                return load_rig(path)
    raise ValueError(f"preset: found {name!r}, expected one of {', '.join(preset_names())}")


def _preset_files() -> list[Any]:
    folder = resources.files("rigs") / "presets"
    return [file for file in folder.iterdir() if file.name.endswith(".yaml")]
