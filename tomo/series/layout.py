"""What a store of frames holds: its arrays in one table, by which it is written and checked."""

from __future__ import annotations

import json
import logging
import math
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import zarr

from rigs.files.size_guard import errors_of_libraries
from rigs.files.text import write_bytes
from tomo.grid import VoxelGrid
from tomo.io.volume_film import create_array, write_coordinates
from tomo.radiometry.units import unit_of_total
from tomo.series.frames import BLOCK

logger = logging.getLogger(__name__)

FORMAT = "emission-series"
VERSION = 1
SUFFIX = ".zarr"

FIGURES = (
    "relative_residual",
    "total_emission",
    "nrmse",
    "cosine_distance",
    "seconds",
    "warnings",
)
"""Figures of a frame, each an array over time; NaN where there is none."""

CAMERA_FIGURES = (
    "view_residual",
    "view_beyond_noise",
    "view_gain",
    "view_light",
    "psnr",
    "ssim",
)
"""Figures of a frame and a camera, each an array over time and camera; NaN where there is none."""

COORDINATES = ("time", "x", "y", "z", "frame")
"""Arrays that are written with the empty store."""

_TYPES = {
    "cameras": list,
    "length_unit": str,
    "value_unit": str,
    "time_unit": str,
    "options": dict,
    "plan": dict,
    "plan_warnings": list,
}
"""Attributes that every reader takes for granted."""

_CHECKSUM = "checksum"
"""The attribute that has the CRC-32 of the others as they were written, and their names."""


_MENDS = "the command that wrote the store writes it again"


class Kind(NamedTuple):
    """How an array is stored."""

    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: str
    dims: tuple[str, ...]


def kinds_of(count: int, grid: VoxelGrid, cameras: int, block: int = BLOCK) -> dict[str, Kind]:
    """Return how the arrays of a store of ``count`` frames are stored, by name."""
    whole = (count, *grid.shape)
    kinds = {"emission": Kind(whole, (1, *grid.shape), "f4", ("time", "x", "y", "z"))}
    for name, length in zip("xyz", grid.shape, strict=True):
        kinds[name] = Kind((length,), (length,), "f8", (name,))
    kinds["time"] = Kind((count,), (count,), "f8", ("time",))
    kinds["frame"] = Kind((count,), (count,), "i8", ("time",))
    for name in FIGURES:
        dtype = "i4" if name == "warnings" else "f8"
        kinds[name] = Kind((count,), (block,), dtype, ("time",))
    for name in CAMERA_FIGURES:
        shape = (count, cameras)
        kinds[name] = Kind(shape, (block, cameras), "f8", ("time", "camera"))
    return kinds | {"complete": Kind((count,), (block,), "u1", ("time",))}


def write_empty(
    path: Path,
    grid: VoxelGrid,
    times: Sequence[float],
    frames: Sequence[int],
    attributes: Mapping[str, Any],
) -> None:
    """Write a store without frames; see `SeriesStore.create`."""
    cameras = attributes["cameras"]
    about = {"format": FORMAT, "version": VERSION, "Conventions": "CF-1.11"}
    about |= {"grid": grid.to_mapping(), **attributes}
    names = sorted(about)
    about[_CHECKSUM] = {"of": names, "crc32": _checksum(about, names)}
    group = zarr.create_group(path, zarr_format=3, attributes=about)
    kinds = kinds_of(len(times), grid, len(cameras))

    def array(name: str, fill: float | None = None, **more: Any) -> zarr.Array:
        return create_array(group, name, *kinds[name], fill, **more)

    unit, length = attributes["value_unit"], attributes["length_unit"]
    array("emission", math.nan, units=unit, long_name="mean emission of a voxel")
    write_coordinates(group, grid, times, length, attributes["time_unit"])
    array("frame", long_name="number in the scan")[:] = np.asarray(frames, np.int64)
    units = {"total_emission": unit_of_total(unit, length)[0], "seconds": "s", "psnr": "dB"}
    for name in FIGURES:
        fill = 0 if name == "warnings" else math.nan
        array(name, fill, units=units.get(name, "1"))
    peak = attributes["plan"].get("peak")
    for name in CAMERA_FIGURES:
        more = {"peak": peak} if peak and name in ("psnr", "ssim") else {}
        array(name, math.nan, units=units.get(name, "1"), cameras=list(cameras), **more)
    words = "1 where the frame is complete, 2 where it could not be read and was left out; "
    words += "written after everything else of its block"
    array("complete", 0, long_name=words)


def open_arrays(path: Path) -> tuple[zarr.Group, dict[str, Any], dict[str, zarr.Array]]:
    """Return the group, the attributes and the arrays of a store, checked against each other."""
    with errors_of_libraries(f"{path}: not a Zarr v3 group, expected a store"):
        group = zarr.open_group(path, mode="r+", zarr_format=3)
        about: dict[str, Any] = dict(group.attrs)
    for name, wanted in (("format", FORMAT), ("version", VERSION)):
        if about.get(name) != wanted:
            raise ValueError(f"{path}: {name}: found {about.get(name)!r}, expected {wanted!r}")
    arrays = {}
    for name in ("emission", *COORDINATES, *FIGURES, *CAMERA_FIGURES, "complete"):
        with errors_of_libraries(f"{path / name / 'zarr.json'}: not readable, {_MENDS}"):
            found = group.get(name)
            dict(() if found is None else found.attrs)  # may be no mapping
        if not isinstance(found, zarr.Array):
            raise ValueError(f"{path}: {name}: found no such array, expected one")
        arrays[name] = found.with_config({"write_empty_chunks": True})
    with errors_of_libraries(f"{path / 'zarr.json'}: attributes"):
        record = arrays["complete"]
        _check_attributes(about, about.pop(_CHECKSUM, None), record.size)
        grid = VoxelGrid(**about["grid"])
        kinds = kinds_of(record.size, grid, len(about["cameras"]), record.chunks[0])
    for name, kind in kinds.items():
        found = arrays[name]
        as_stored = found.shape, found.shards or found.chunks, found.dtype
        if as_stored != (kind.shape, kind.chunks, np.dtype(kind.dtype)):
            raise ValueError(
                f"{path / name / 'zarr.json'}: found {found.dtype} {found.shape} in chunks of "
                f"{found.chunks}, expected {np.dtype(kind.dtype)} {kind.shape} in chunks of "
                f"{kind.chunks} by the store's other arrays: {_MENDS}"
            )
    return group, about, arrays


def mend_descriptions(path: Path, times: Sequence[float], frames: Sequence[int]) -> None:
    """Write damaged descriptions of arrays (``zarr.json``) again, from the store's attributes.

    Not where every one is another than this version writes: the store is an older one.
    """
    try:
        open_arrays(path)
        return
    except ValueError as error:
        damage = error
    try:
        with errors_of_libraries(str(path)):
            about: dict[str, Any] = dict(zarr.open_group(path, mode="r", zarr_format=3).attrs)
            stored = about[_CHECKSUM]
            _check_attributes(about, stored, len(frames))
            about = {name: about[name] for name in stored["of"]}
            names, grid = about["scan"]["frames"], VoxelGrid(**about["grid"])
    except ValueError:
        raise damage from None
    with TemporaryDirectory() as folder:
        write_empty(Path(folder) / path.name, grid, times, frames, about)
        fresh = {one.parent.name: one.read_bytes() for one in Path(folder).glob("*/*/zarr.json")}
    files = {name: path / name / "zarr.json" for name in sorted(fresh)}
    other = [
        name
        for name, file in files.items()
        if not file.is_file() or file.read_bytes() != fresh[name]
    ]
    if len(other) == len(fresh) or len(names) != len(frames):
        raise damage
    for name in other:
        logger.warning("%s: damaged; written again", path / name / "zarr.json")
        (path / name).mkdir(exist_ok=True)
        write_bytes(path / name / "zarr.json", fresh[name])


def _check_attributes(
    about: Mapping[str, Any], stored: Mapping[str, Any] | None, count: int
) -> None:
    """Raise unless attributes are as written, by a checksum that earlier versions lack."""
    if stored is not None and _checksum(about, stored["of"]) != stored["crc32"]:
        raise ValueError(
            "found another checksum than they were written with: damaged or edited; copy the file "
            "from another copy of the store, or write another store"
        )
    for name, kind in _TYPES.items():
        if not isinstance(about.get(name), kind):
            raise ValueError(f"{name}: found {about.get(name)!r}, expected a {kind.__name__}")
    frames = (about.get("scan") or {}).get("frames") or []
    if not all(isinstance(one, str) for one in about["cameras"] + frames):
        raise ValueError("cameras, scan.frames: found other values, expected names")
    if 0 < len(frames) < count:
        raise ValueError(f"scan.frames: found {len(frames)} names, expected {count}")
    for camera in (about.get("rig") or {}).get("cameras") or ():
        dict(camera)["name"]  # or an error is raised


def _checksum(about: Mapping[str, Any], names: Sequence[str]) -> int:
    """Return the CRC-32 of attributes as JSON; others may be added to a store."""
    text = json.dumps({name: about.get(name) for name in names}, sort_keys=True)
    return zlib.crc32(text.encode())
