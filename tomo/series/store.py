"""The store of a series: a Zarr v3 group that xarray reads, a chunk a frame, a record a block.

Arrays of a block are renamed into place and are on the disk before its chunk of ``complete``: a
frame counts where that is 1. Checksums of chunks show other damage.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray

from rigs.files import atomic_path
from tomo.grid import Volume, VoxelGrid
from tomo.io.volume_film import note_without_checksums
from tomo.io.xarray_volumes import xarray_or_pip_line
from tomo.series.chunks import Chunks
from tomo.series.layout import CAMERA_FIGURES, FIGURES, open_arrays, write_empty
from tomo.series.solving import FrameResult

if TYPE_CHECKING:
    from xarray import Dataset

COMPLETE, LEFT_OUT = 1, 2
"""States of a frame in ``complete``; 0 where it is still to be done."""


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
        self.group, self.attributes, arrays = open_arrays(self.path)
        self._chunks = Chunks(self.path, arrays)
        if not self._chunks.have_checksums:
            note_without_checksums(self.path)

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

        ``times`` are seconds, or numbers of frames where no rate is known; ``frames`` numbers in
        the scan; ``attributes`` plain values, among them ``length_unit, value_unit, time_unit,
        cameras``.
        """
        path = Path(path)
        if not path.exists():
            try:
                with atomic_path(path, durable=True) as staging:
                    write_empty(staging, grid, times, frames, attributes)
            except OSError:  # another run was faster
                if not path.is_dir():
                    raise
        return cls(path)

    def array(self, name: str) -> zarr.Array:
        """Return one of the arrays, unread."""
        if name not in self._chunks.arrays:
            raise ValueError(f"{self.path}: {name}: found no such array, expected one")
        return self._chunks.arrays[name]

    def unit(self, name: str) -> str:
        """Return the unit of an array's numbers; "1" where it has none."""
        return str(self.array(name).attrs.get("units", "1"))

    def values(self, name: str) -> NDArray:
        """Return the numbers of an array; a line names the file and frames of a damaged chunk."""
        self.array(name)  # or it is refused
        return self._chunks.values(name, self._recorded() > 0 if name in _OF_FRAMES else None)

    @cached_property
    def grid(self) -> VoxelGrid:
        """The grid of the volumes; coordinates other than the attributes' are refused."""
        grid = VoxelGrid(**self.attributes["grid"])
        for name, centres in zip("xyz", grid.axes(), strict=True):
            if not np.array_equal(found := self.values(name), centres):
                raise ValueError(
                    f"{self.path}: {name}: found {found[0]:.9g} to {found[-1]:.9g}, expected "
                    f"{centres[0]:.9g} to {centres[-1]:.9g} by the attribute grid: damaged"
                )
        return grid

    @property
    def n_frames(self) -> int:
        """Frames that the store is for."""
        return self.array("emission").shape[0]

    @property
    def states(self) -> NDArray[np.uint8]:
        """`COMPLETE`, `LEFT_OUT`, or 0: to be done, as where a volume is gone, ``(frames,)``."""
        found = self._recorded()
        for place in np.flatnonzero(found == COMPLETE).tolist():
            found[place] *= self._chunks.file("emission", place).is_file()
        return found

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Which frames have a volume, ``(frames,)``."""
        return self.states == COMPLETE

    @property
    def skipped(self) -> NDArray[np.bool_]:
        """Which frames could not be read and were left out, ``(frames,)``."""
        return self.states == LEFT_OUT

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do: every frame is complete or was left out."""
        return bool(self.states.all())

    def done(self) -> str:
        """Return in words how many frames are complete, for messages of a run that ends early."""
        return f"{int(self.complete.sum())} of {self.n_frames} frames are complete and stay"

    def is_complete(self, block: range) -> bool:
        """Return whether nothing is left to do of a block."""
        return bool(self._recorded(block).all())

    def volume(self, place: int) -> Volume:
        """Return the volume of a frame by its place in the store, if it is complete and sound."""
        (state,) = self._recorded(range(place, place + 1))
        if state != COMPLETE:
            found = "left out, as it could not be read" if state == LEFT_OUT else "missing"
            raise ValueError(f"{self.path}: frame {place}: found it {found}, expected a volume")
        values = self._chunks.read("emission", range(place, place + 1))[0]
        units = self.attributes["length_unit"], self.attributes["value_unit"]
        return Volume(values, self.grid, *units)

    def volumes(self, places: Iterable[int] | None = None) -> Iterator[Volume]:
        """Yield the volumes of frames by their places, of all that are complete when None."""
        for place in np.flatnonzero(self.complete).tolist() if places is None else places:
            yield self.volume(place)

    def check_present(self, places: Iterable[int]) -> None:
        """Refuse where the volume of a frame that is recorded as complete is gone, by name."""
        gone = (self._recorded() == COMPLETE) & ~self.complete
        for place in places:
            if gone[place]:
                self.volume(place)

    def to_xarray(self) -> Dataset:
        """Return the store as an `xarray.Dataset` that reads when asked; NaN where nothing is."""
        return xarray_or_pip_line().open_zarr(self.path, consolidated=False)

    def write_volume(self, place: int, volume: NDArray[np.float32]) -> None:
        """Write the volume of a frame; it counts once its block is finished."""
        self._chunks.write("emission", range(place, place + 1), volume[None])

    def write_coordinates(self, name: str, values: ArrayLike) -> None:
        """Write one of the arrays `COORDINATES` again."""
        whole = range(self.array(name).shape[0])
        self._chunks.write(name, whole, values)
        self._chunks.flush(self._chunks.files(name, whole))

    def finish(self, block: range, results: Sequence[FrameResult]) -> None:
        """Write the figures of a block, then its record, once all else of it is on the disk."""
        for name in FIGURES:
            of_frames = [one.figures.get(name, math.nan) for one in results]
            if name == "warnings":
                of_frames = [len(one.warnings) for one in results]
            self._chunks.write(name, block, of_frames)
        cameras = self.attributes["cameras"]
        for name in CAMERA_FIGURES:
            by_camera = [one.by_camera.get(name, {}) for one in results]
            rows = [[one.get(camera, math.nan) for camera in cameras] for one in by_camera]
            self._chunks.write(name, block, rows)
        states = [LEFT_OUT if one.skipped else COMPLETE for one in results]
        read = [place for place, state in zip(block, states, strict=True) if state == COMPLETE]
        volumes = [self._chunks.file("emission", place) for place in read]
        self._chunks.flush(volumes + [f for n in _OF_FRAMES for f in self._chunks.files(n, block)])
        self._record(block, states)

    def forget(self, block: range, places: Collection[int]) -> None:
        """Record frames of a block as to be done again; the others stay as they are."""
        states = np.zeros(len(block), np.uint8)
        if len(places) < len(block):  # else the record itself may be damaged
            states[:] = self._recorded(block)
            states[[place - block.start for place in places]] = 0
        self._record(block, states)

    def damage(self, block: range) -> dict[int, str]:
        """Read a block through; return frames recorded as done but not readable, each with why."""
        try:
            record = self._recorded(block)
            for name in _OF_FRAMES if record.any() else ():
                self._chunks.read(name, block)
        except ValueError as error:
            return dict.fromkeys(block, str(error))
        found = {}
        for place, state in zip(block, record, strict=True):
            if state == COMPLETE:
                try:
                    self._chunks.read("emission", range(place, place + 1))
                except ValueError as error:
                    found[place] = str(error)
        return found

    def remove_partial(self, block: range) -> None:
        """Remove what a killed process left half-written of a block that no other process has."""
        self._chunks.remove_partial(("emission", *_OF_FRAMES, "complete"), block)

    def _recorded(self, places: range | None = None) -> NDArray[np.uint8]:
        """Return what is recorded of frames, of all when None; 0 where nothing is."""
        if places is None:
            found = self._chunks.values("complete", np.zeros(self.n_frames, bool))
        else:
            found = self._chunks.read("complete", places, needed=False)
        if found.max(initial=0) > LEFT_OUT:
            raise ValueError(f"{self.path}: complete: found {found.max()}, expected 0, 1 or 2")
        return found

    def _record(self, block: range, states: ArrayLike) -> None:
        """Write the record of a block, on the disk when this returns."""
        self._chunks.write("complete", block, states)
        self._chunks.flush(self._chunks.files("complete", block))


_OF_FRAMES = (*FIGURES, *CAMERA_FIGURES)
"""Arrays that are written with each block."""
