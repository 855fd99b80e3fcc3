"""Writing rig.yaml, and the files beside it: tables of rays, meshes, gas."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import yaml

from rigs.camera_protocol import CameraLike, LensCamera
from rigs.files.atomic import whole_folder
from rigs.files.rig_yaml import HEAD
from rigs.files.text import breaks_a_line, write_text
from rigs.ray_table import RayTable
from rigs.ray_table.ray_file import save_ray_table
from rigs.rig import Rig
from rigs.scene.entry import scene_data, write_mesh
from rigs.scene.gas import write_voxels
from rigs.scene.mesh import Mesh
from rigs.scene.scene_camera import own_camera


def save_rig(rig: Rig, path: str | os.PathLike) -> None:
    """Write ``rig`` to a ``rig.yaml``; `load_rig` returns an equal one, bit by bit.

    Poses are written as ``R`` and ``t``, intrinsics as ``camera_matrix``. ``cv2.FileStorage``
    reads the file too, as long as the keys in ``rig.calibration`` are plain words. Tables of rays
    are written into the same folder, as ``<stem>_rays_<camera>.npz``, meshes of the scene as
    ``<stem>_solid_<number>.obj``, its gas as ``<stem>_gas_index.npz`` and ``_extinction.npz``.

    Raises
    ------
    ValueError
        If ``rig.calibration`` holds something other than plain data.
    """
    path = Path(path)
    text, stem = rig_to_yaml(rig, path.stem), path.stem
    beside: dict[str, Callable[[Path], None]] = {}
    for camera in map(own_camera, rig):
        if isinstance(camera, RayTable):
            beside[_table_name(camera, stem)] = partial(save_ray_table, camera)
    for number, solid in enumerate(rig.scene.solids if rig.scene else ()):
        if isinstance(solid, Mesh):
            beside[_mesh_name(number, stem)] = partial(write_mesh, solid)
    gas = rig.scene and rig.scene.gas
    for name in ("index", "extinction") if gas else ():
        voxels = getattr(gas, name)
        if voxels is not None:
            beside[_gas_name(name, stem)] = partial(
                write_voxels, voxels, length_unit=rig.length_unit
            )
    if not beside:
        write_text(path, text)
        return
    with whole_folder(path.parent, last=(path.name,)) as folder:
        for name, write in beside.items():
            write(folder / name)
        write_text(folder / path.name, text)


def rig_to_yaml(rig: Rig, stem: str = "rig") -> str:
    """Return the text that `save_rig` writes into a file of that stem."""
    data: dict[str, Any] = {
        **HEAD,
        "length_unit": rig.length_unit,
        "convention": "opencv",
        "world_frame": rig.world_frame,
        "cameras": [_camera_data(own_camera(camera), stem) for camera in rig.cameras],
    }
    if rig.volume is not None:
        data["volume"] = {
            "shape": list(rig.volume.shape),
            "spacing": list(rig.volume.spacing),
            "center": list(rig.volume.center),
        }
    if rig.scene is not None:
        solids = rig.scene.solids
        data["scene"] = scene_data(
            rig.scene,
            lambda mesh: _mesh_name(solids.index(mesh), stem),
            lambda name: _gas_name(name, stem),
        )
    if rig.calibration is not None:
        _check_plain(rig.calibration, "calibration")
        data["calibration"] = rig.calibration
    return yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=2**30, indent=2
    )


def _table_name(camera: RayTable, stem: str) -> str:
    """Return the name of the file of a camera's rays, for a rig of that stem."""
    return f"{stem}_rays_{camera.name}.npz"


def _mesh_name(number: int, stem: str) -> str:
    """Return the name of the file of a scene's mesh, for a rig of that stem."""
    return f"{stem}_solid_{number}.obj"


def _gas_name(name: str, stem: str) -> str:
    """Return the name of the file of a scene's gas, for a rig of that stem."""
    return f"{stem}_gas_{name}.npz"


def _camera_data(camera: CameraLike, stem: str) -> dict[str, Any]:
    """Return a camera's plain data, in the order of the file."""
    if isinstance(camera, RayTable):
        table = {"name": camera.name, "ray_table": _table_name(camera, stem)}
        return table | _last_data(camera)
    lens = cast("LensCamera", camera)
    data: dict[str, Any] = {
        "name": camera.name,
        "image_size": list(camera.image_size),
        "camera_matrix": camera.camera_matrix.tolist(),
        "distortion": {
            "model": lens.distortion.model,
            "coefficients": list(lens.distortion.coefficients),
        },
        "R": camera.R.tolist(),
        "t": camera.t.tolist(),
    }
    return data | _last_data(camera)


def _last_data(camera: CameraLike) -> dict[str, Any]:
    """Return the entries that all cameras end with."""
    return {
        name: value if isinstance(value, str) else _known(value)
        for name in ("optics", "status", "accuracy")
        if (value := getattr(camera, name)) is not None
    }


def _known(value: object) -> dict[str, float]:
    """Return the numbers of a value that are known, by name."""
    return {name: number for name, number in vars(value).items() if number is not None}


def _check_plain(value: object, what: str) -> None:
    """Raise unless ``value`` consists of types that YAML and JSON both hold."""
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                raise ValueError(f"{what}: found the key {key!r}, expected text")
            _check_plain(item, f"{what}.{key}")
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            _check_plain(item, f"{what}[{index}]")
    elif type(value) not in (str, int, float, bool, type(None)):
        raise ValueError(f"{what}: found {type(value).__name__}, expected plain data")
    elif isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{what}: found {value}, expected finite numbers")


class _Dumper(yaml.SafeDumper):
    """Writes rows of numbers on one line each, and indents lists as OpenCV's reader needs."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        return super().increase_indent(flow, False)

    def ignore_aliases(self, data: object) -> bool:
        return True

    def _list(self, data: list | tuple) -> yaml.Node:
        on_one_line = not any(isinstance(item, (list, tuple, dict)) for item in data)
        return self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=on_one_line)

    def _text(self, data: str) -> yaml.Node:
        # PyYAML would write line breaks as they are, and read some of them as others.
        style = '"' if breaks_a_line(data) or data != data.rstrip() else None
        return self.represent_scalar("tag:yaml.org,2002:str", data, style=style)


_Dumper.add_representer(str, _Dumper._text)
_Dumper.add_representer(list, _Dumper._list)
_Dumper.add_representer(tuple, _Dumper._list)
