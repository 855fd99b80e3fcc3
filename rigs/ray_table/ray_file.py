"""Tables of rays in ``.npz`` files."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np

from rigs.figures import Optics
from rigs.files.size_guard import path_inside, read_arrays
from rigs.files.text import write_bytes
from rigs.ray_table.ray_table import RayTable

_OPTIONAL = ("image_size", "scale", "offset")


def load_ray_table(
    name: str,
    file: str,
    folder: str | os.PathLike = ".",
    optics: Optics | None = None,
    status: str = "calibrated",
) -> RayTable:
    """Return the camera of an ``.npz`` with ``origins`` and ``directions``, inside ``folder``.

    See `rigs.RayTable`, also for the optional arrays ``image_size, scale, offset``.
    """
    where = f"camera {name}: ray_table"
    path = path_inside(file, Path(folder), where)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file, which camera {name} has for ray_table")
    try:
        found = read_arrays(path)
    except ValueError as error:
        raise ValueError(f"{where}: {file}: {error}") from None
    for key in ("origins", "directions"):
        if key not in found:
            raise ValueError(f"{where}: {file}: {key}: missing, expected (height, width, 3)")
    for key in found:
        if key not in ("origins", "directions", *_OPTIONAL):
            raise ValueError(f"{where}: {file}: {key}: unknown array")
        if found[key].dtype.kind not in "fiu":
            raise ValueError(
                f"{where}: {file}: {key}: found {found[key].dtype}, expected real numbers"
            )
    more = {key: found[key].tolist() for key in _OPTIONAL if key in found}
    return RayTable(
        name, found["origins"], found["directions"], optics=optics, status=status, **more
    )


def save_ray_table(camera: RayTable, path: str | os.PathLike) -> None:
    """Write a camera's rays to an ``.npz``: `load_ray_table` returns an equal one."""
    file = io.BytesIO()
    np.savez(
        file,
        origins=camera.own_origins,
        directions=camera.directions,
        image_size=np.array(camera.image_size),
        scale=np.array(camera.scale),
        offset=np.array(camera.offset),
    )
    write_bytes(path, file.getvalue())
