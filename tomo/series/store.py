"""The store of a series: a Zarr v3 group that xarray reads, a chunk a frame, a record a block.

Arrays of a block are written first, its chunk of ``complete`` last: a frame counts where that is
1. Each file is renamed into place, so that a process that is killed leaves no half-written one.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr
from numpy.typing import NDArray

from rigs.files import atomic_path
from tomo.grid import VoxelGrid
from tomo.io.volume_film import write_coordinates
from tomo.io.xarray_volumes import xarray_or_pip_line
from tomo.radiometry.units import unit_of_total
from tomo.series.frames import BLOCK
from tomo.series.solving import FrameResult

if TYPE_CHECKING:
    from xarray import Dataset

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

COMPLETE, LEFT_OUT = 1, 2
"""States of a frame in ``complete``; 0 where it is still to be done."""

WALL_TIME = ("seconds",)
"""Arrays that differ from run to run."""


class SeriesStore:
    """A store of frames on disk.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    FileNotFoundError
        If there is nothing at ``path``.
    ValueError
        If it is no store of a series.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        if not self.path.is_dir():
            raise FileNotFoundError(f"{self.path}: no such store")
        try:
            self.group = zarr.open_group(self.path, mode="r+", zarr_format=3)
        except (FileNotFoundError, ValueError, KeyError, TypeError):
            raise ValueError(f"{self.path}: not a Zarr v3 group, expected a store") from None
        self.attributes: dict[str, Any] = dict(self.group.attrs)
        if self.attributes.get("format") != FORMAT:
            found = self.attributes.get("format")
            raise ValueError(f"{self.path}: format: found {found!r}, expected {FORMAT!r}")
        if self.attributes.get("version") != VERSION:
            found = self.attributes.get("version")
            raise ValueError(f"{self.path}: version: found {found!r}, expected {VERSION}")
        for name in _NAMES:
            self.array(name)

    def __repr__(self) -> str:
        return f"SeriesStore({str(self.path)!r})"

    @classmethod
    def create(
        cls,
        path: str | os.PathLike,
        grid: VoxelGrid,
        times: Sequence[float],
        frames: Sequence[int],
        attributes: Mapping[str, Any],
    ) -> SeriesStore:
        """Make an empty store, whole or not at all; open the one that is there, if there is one.

        Parameters
        ----------
        path : path-like
        grid : VoxelGrid
        times : sequence of float
            Seconds, or numbers of frames where no frame rate is known.
        frames : sequence of int
            The numbers of the frames in their scan.
        attributes : mapping
            ``length_unit``, ``value_unit``, ``time_unit``, ``cameras`` and what else is to be
            known; plain values.
        """
        path = Path(path)
        if not path.exists():
            try:
                with atomic_path(path) as staging:
                    _write_empty(staging, grid, times, frames, attributes)
            except OSError:  # another run was faster
                if not path.is_dir():
                    raise
        return cls(path)

    def array(self, name: str) -> zarr.Array:
        """Return one of the arrays, unread.

        Raises
        ------
        ValueError
            If there is none of that name.
        """
        found = self.group.get(name)
        if not isinstance(found, zarr.Array):
            raise ValueError(f"{self.path}: {name}: found no such array, expected one")
        return found

    def values(self, name: str) -> NDArray:
        """Return the numbers of an array of that name, such as ``frame`` or a figure."""
        return np.asarray(self.array(name)[:])

    @property
    def grid(self) -> VoxelGrid:
        """The grid of the volumes."""
        return VoxelGrid(**self.attributes["grid"])

    @property
    def n_frames(self) -> int:
        """Frames that the store is for."""
        return self.array("emission").shape[0]

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Which frames have a volume, ``(frames,)``."""
        return self.values("complete") == COMPLETE

    @property
    def skipped(self) -> NDArray[np.bool_]:
        """Which frames could not be read and were left out, ``(frames,)``."""
        return self.values("complete") == LEFT_OUT

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do: every frame is complete or was left out."""
        return bool(self.values("complete").all())

    def done(self) -> str:
        """Return in words how many frames are complete, for messages of a run that ends early."""
        return f"{int(self.complete.sum())} of {self.n_frames} frames are complete and stay"

    def is_complete(self, block: range) -> bool:
        """Return whether nothing is left to do of a block."""
        return bool(np.all(self.array("complete")[block.start : block.stop]))

    def volume(self, place: int) -> NDArray[np.float32]:
        """Return the volume of a frame by its place in the store, ``(nx, ny, nz)``.

        Raises
        ------
        ValueError
            If the frame is not complete.
        """
        if (state := self.array("complete")[place]) != COMPLETE:
            found = "left out, as it could not be read" if state == LEFT_OUT else "missing"
            raise ValueError(f"{self.path}: frame {place}: found it {found}, expected a volume")
        return np.asarray(self.array("emission")[place])

    def to_xarray(self) -> Dataset:
        """Return the store as an `xarray.Dataset` that reads when asked; NaN where nothing is yet.

        Raises
        ------
        ValueError
            If xarray is not installed.
        """
        return xarray_or_pip_line().open_zarr(self.path, consolidated=False)

    def write_volume(self, place: int, volume: NDArray[np.float32]) -> None:
        """Write the volume of a frame; it counts once its block is finished."""
        self.array("emission")[place] = volume

    def finish(self, block: range, results: Sequence[FrameResult]) -> None:
        """Write the figures of a block whose volumes are written, and then its record."""
        at = slice(block.start, block.stop)
        for name in FIGURES:
            values: Sequence[float]
            if name == "warnings":
                values = [len(one.warnings) for one in results]
            else:
                values = [one.figures.get(name, math.nan) for one in results]
            array = self.array(name)
            array[at] = np.array(values, array.dtype)
        cameras = self.attributes["cameras"]
        for name in CAMERA_FIGURES:
            self.array(name)[at] = np.array(
                [
                    [one.by_camera.get(name, {}).get(camera, math.nan) for camera in cameras]
                    for one in results
                ]
            )
        states = [LEFT_OUT if one.skipped else COMPLETE for one in results]
        self.array("complete")[at] = np.array(states, np.uint8)

    def remove_partial(self, block: range) -> None:
        """Remove what a killed process left half-written of a block that no other process has."""
        for place in block:
            folder = self.path / "emission" / "c" / str(place)
            for left in folder.rglob("*.partial"):
                left.unlink(missing_ok=True)


def _write_empty(
    path: Path,
    grid: VoxelGrid,
    times: Sequence[float],
    frames: Sequence[int],
    attributes: Mapping[str, Any],
) -> None:
    """Write a store without frames."""
    count, cameras = len(times), attributes["cameras"]
    group = zarr.create_group(
        path,
        zarr_format=3,
        attributes={
            "format": FORMAT,
            "version": VERSION,
            "Conventions": "CF-1.11",
            "grid": grid.to_mapping(),
            **attributes,
        },
    )

    def array(name, shape, chunks, dtype, dims, fill=None, **about):
        return group.create_array(
            name,
            shape=shape,
            chunks=chunks,
            dtype=dtype,
            fill_value=fill,
            dimension_names=dims,
            attributes=about,
        )

    unit, length = attributes["value_unit"], attributes["length_unit"]
    array(
        "emission", (count, *grid.shape), (1, *grid.shape), "f4", ("time", "x", "y", "z"),
        math.nan, units=unit, long_name="mean emission of a voxel",
    )  # fmt: skip
    write_coordinates(group, grid, times, length, attributes["time_unit"])
    array("frame", (count,), (count,), "i8", ("time",), long_name="number in the scan")[:] = frames
    units = {"total_emission": unit_of_total(unit, length)[0], "seconds": "s", "psnr": "dB"}
    for name in FIGURES:
        dtype, fill = ("i4", 0) if name == "warnings" else ("f8", math.nan)
        array(name, (count,), (BLOCK,), dtype, ("time",), fill, units=units.get(name, "1"))
    peak = attributes["plan"].get("peak")
    for name in CAMERA_FIGURES:
        shape, chunks = (count, len(cameras)), (BLOCK, len(cameras))
        about = {"peak": peak} if peak and name in ("psnr", "ssim") else {}
        array(
            name, shape, chunks, "f8", ("time", "camera"), math.nan, units=units.get(name, "1"),
            cameras=list(cameras), **about,
        )  # fmt: skip
    words = "1 where the frame is complete, 2 where it could not be read and was left out; "
    words += "written after everything else of its block"
    array("complete", (count,), (BLOCK,), "u1", ("time",), 0, long_name=words)


_NAMES = ("emission", "time", "x", "y", "z", "frame", *FIGURES, *CAMERA_FIGURES, "complete")
