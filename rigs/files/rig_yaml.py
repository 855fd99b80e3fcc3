"""Reading and writing rig.yaml."""

from __future__ import annotations

import math
import os
from importlib import resources
from pathlib import Path
from typing import Any, cast

import yaml

from rigs.camera import Camera, look_at
from rigs.camera_protocol import CameraLike, LensCamera
from rigs.files.schema import CameraEntry, RigEntry, SceneEntry, parse_rig
from rigs.files.text import breaks_a_line, read_yaml_mapping, write_text
from rigs.lens import Distortion
from rigs.optics import Optics
from rigs.placed_camera import matrix_of_lens, optics_of_lens
from rigs.ray_table import RayTable
from rigs.ray_table.ray_file import load_ray_table, save_ray_table
from rigs.rig import Rig, Volume
from rigs.scene.entry import scene_data, scene_of
from rigs.scene.gas import write_voxels
from rigs.scene.mesh import Mesh
from rigs.scene.mesh_file import write_mesh
from rigs.scene.scene import Scene
from rigs.scene.scene_camera import own_camera

FORMAT = "emission-rig"
VERSION = 1


def load_rig(path: str | os.PathLike) -> Rig:
    """Return the rig in a ``rig.yaml``.

    A camera's pose is ``R`` and ``t``, or ``position``, ``look_at`` and ``up``; its intrinsics
    are ``camera_matrix``, or ``focal_length`` and ``pixel_pitch`` in one unit (with
    ``principal_point`` in pixels, by default the image's middle). Instead of both it may name a
    ``ray_table``, an ``.npz`` in the file's folder (`rigs.RayTable`). With a ``scene`` the cameras
    look through it (`rigs.scene.SceneCamera`).

    Raises
    ------
    FileNotFoundError, IsADirectoryError
        If there is no such file.
    ValueError
        In one line that names the file, the camera, the field, what was found and what was
        expected.
    """
    data = read_yaml_mapping(path)
    try:
        for field, expected in (("format", FORMAT), ("version", VERSION)):
            if field not in data:
                raise ValueError(f"{field}: missing, expected {expected}")
            if data[field] != expected or isinstance(data[field], bool):
                raise ValueError(f"{field}: found {data[field]!r}, expected {expected}")
        entry = parse_rig(data)
        if entry.convention != "opencv":
            raise ValueError(f"convention: found {entry.convention!r}, expected opencv")
        return _rig(entry, Path(path).parent)
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


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
    text = rig_to_yaml(rig, Path(path).stem)
    stem = Path(path).stem
    for camera in map(own_camera, rig):
        if isinstance(camera, RayTable):
            save_ray_table(camera, Path(path).with_name(_table_name(camera, stem)))
    for number, solid in enumerate(rig.scene.solids if rig.scene else ()):
        if isinstance(solid, Mesh):
            write_mesh(solid, Path(path).with_name(_mesh_name(number, stem)))
    gas = rig.scene and rig.scene.gas
    for name in ("index", "extinction") if gas else ():
        voxels = getattr(gas, name)
        if voxels is not None:
            write_voxels(voxels, Path(path).with_name(_gas_name(name, stem)), rig.length_unit)
    write_text(path, text)


def rig_to_yaml(rig: Rig, stem: str = "rig") -> str:
    """Return the text that `save_rig` writes into a file of that stem."""
    data: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
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


def load_scene(path: str | os.PathLike, length_unit: str = "mm") -> Scene:
    """Return the scene in a YAML file that holds the ``scene`` of a rig.yaml, or its contents.

    Parameters
    ----------
    path : path
    length_unit : str
        Of the file's lengths.

    Raises
    ------
    FileNotFoundError
        If there is no such file, or a mesh's is missing.
    ValueError
        In one line: the file, the solid, the field, what was found and what was expected.
    """
    data = read_yaml_mapping(path)
    try:
        own = data.get("scene", data)
        head = {"format": FORMAT, "version": VERSION, "cameras": []}
        entry = parse_rig({**head, "scene": own}).scene
        if entry is None or not entry.solids:
            raise ValueError("scene: found no solids, expected at least one")
        return scene_of(entry, Path(path).parent, length_unit)
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


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


def _rig(entry: RigEntry, folder: Path) -> Rig:
    """Return the rig of a checked file in ``folder``."""
    if not entry.cameras:
        raise ValueError("cameras: found none, expected at least one")
    box = entry.volume
    volume = None if box is None else Volume(box.shape, box.spacing, box.center)
    cameras = tuple(_camera(camera, folder) for camera in entry.cameras)
    rig = Rig(cameras, entry.length_unit, entry.world_frame, volume, entry.calibration)
    return rig if entry.scene is None else _in_scene(rig, entry.scene, folder)


def _in_scene(rig: Rig, entry: SceneEntry, folder: Path) -> Rig:
    """Return the rig whose cameras look through the scene of a checked entry."""
    from rigs.scene.checks import check_scene

    scene = scene_of(entry, folder, rig.length_unit)
    check_scene(scene, rig)
    return rig.through(scene)


def _camera(entry: CameraEntry, folder: Path) -> CameraLike:
    """Return the camera of a checked entry."""
    if entry.ray_table is not None:
        return _ray_table(entry, entry.ray_table, folder)
    try:
        if entry.image_size is None:
            raise ValueError("image_size: missing, expected width and height in pixels")
        distortion = Distortion(entry.distortion.model, tuple(entry.distortion.coefficients))
        optics = _optics(entry)
        K = _intrinsics(entry)
        optics = optics_of_lens(entry.focal_length, entry.pixel_pitch, optics)
        R, t = _pose(entry)
    except ValueError as error:
        raise ValueError(f"camera {entry.name}: {error}") from None
    return Camera(entry.name, entry.image_size, K, distortion, R, t, optics, entry.status)


def _optics(entry: CameraEntry) -> Optics | None:
    return None if entry.optics is None else Optics(**entry.optics.model_dump())


def _ray_table(entry: CameraEntry, file: str, folder: Path) -> RayTable:
    """Return the table of rays in a file that an entry names."""
    kept = {"name", "ray_table", "image_size", "optics", "status"}
    try:
        for field in sorted(entry.model_fields_set - kept):
            raise ValueError(f"{field}: found together with ray_table, expected one of the two")
        optics = _optics(entry)
    except ValueError as error:
        raise ValueError(f"camera {entry.name}: {error}") from None
    camera = load_ray_table(entry.name, file, folder, optics, entry.status)
    if entry.image_size not in (None, camera.image_size):
        raise ValueError(
            f"camera {entry.name}: image_size: found {entry.image_size}, "
            f"expected {camera.image_size} as in {file}"
        )
    return camera


def _table_name(camera: RayTable, stem: str) -> str:
    """Return the name of the file of a camera's rays, for a rig of that stem."""
    return f"{stem}_rays_{camera.name}.npz"


def _mesh_name(number: int, stem: str) -> str:
    """Return the name of the file of a scene's mesh, for a rig of that stem."""
    return f"{stem}_solid_{number}.obj"


def _gas_name(name: str, stem: str) -> str:
    """Return the name of the file of a scene's gas, for a rig of that stem."""
    return f"{stem}_gas_{name}.npz"


def _intrinsics(entry: CameraEntry) -> Any:
    """Return the camera matrix, as given or from the focal length and the pixel pitch."""
    short = ("focal_length", "pixel_pitch", "principal_point")
    given = [name for name in short if getattr(entry, name) is not None]
    if entry.camera_matrix is not None:
        if given:
            raise ValueError(
                f"{given[0]}: found together with camera_matrix, expected one of the two"
            )
        return entry.camera_matrix
    for name in short[:2]:
        if name not in given:
            raise ValueError(
                f"{name if given else 'camera_matrix'}: missing, expected camera_matrix, "
                "or focal_length and pixel_pitch"
            )
    size = cast("tuple[int, int]", entry.image_size)  # both were looked for above
    focal, pitch = cast("float", entry.focal_length), entry.pixel_pitch
    assert pitch is not None
    return matrix_of_lens(size, focal, pitch, entry.principal_point)


def _pose(entry: CameraEntry) -> tuple[Any, Any]:
    """Return ``R`` and ``t``, as given or from position, look_at and up."""
    groups = (("R", "t"), ("position", "look_at", "up"))
    given = [[name for name in names if getattr(entry, name) is not None] for names in groups]
    if given[0] and given[1]:
        raise ValueError(
            f"{given[1][0]}: found together with {given[0][0]}, expected one of the two"
        )
    names = groups[1] if given[1] else groups[0]
    for name in names:
        if getattr(entry, name) is None:
            raise ValueError(f"{name}: missing, expected R and t, or position, look_at and up")
    if given[1]:
        return look_at(*(getattr(entry, name) for name in groups[1]))
    return entry.R, entry.t


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
    if camera.optics is None:
        return {"status": camera.status}
    optics = {k: v for k, v in vars(camera.optics).items() if v is not None}
    return {"optics": optics, "status": camera.status}


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
