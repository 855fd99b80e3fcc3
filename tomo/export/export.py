"""Exporting the frames of a store: the formats in a table, and what they have in common."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigs.progress import Progress, progress_of
from tomo.grid import Volume
from tomo.series.store import COMPLETE, SeriesStore

LARGEST_CHUNK = 1 << 30
"""Bytes of a chunk of a file, at the most: HDF5 takes 4 GiB, readers hold a few in memory."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of a store."""

    store: SeriesStore
    places: tuple[int, ...]
    progress: Progress | None = None

    def __len__(self) -> int:
        return len(self.places)

    @cached_property
    def times(self) -> NDArray[np.float64]:
        """When they were taken, ``(frames,)``, in the store's ``time_unit``."""
        return self.of("time")

    @cached_property
    def numbers(self) -> NDArray[np.int64]:
        """Their numbers in the scan, ``(frames,)``."""
        return self.of("frame")

    def of(self, name: str) -> NDArray:
        """Return their part of an array of the store."""
        return self.store.values(name)[list(self.places)]

    def volumes(self, words: str = "") -> Iterator[Volume]:
        """Yield their volumes ``(nx, ny, nz)``, one after the other."""
        for done, place in enumerate(self.places):
            if self.progress:
                self.progress(done, len(self), f"{words}frame {place}")
            yield self.store.volume(place)
        if self.progress:
            self.progress(len(self), len(self), "")

    def chunk(self) -> tuple[int, int, int]:
        """Return the shape of a chunk of a frame, ``(nx, ny, nz)``: whole, or some planes of x."""
        nx, ny, nz = self.store.grid.shape
        return min(nx, max(LARGEST_CHUNK // (4 * ny * nz), 1)), ny, nz

    def axis(self, name: str) -> tuple[NDArray[np.float64], str]:
        """Return the centres of voxels along ``x``, ``y`` or ``z``, and their unit."""
        centres = dict(zip("xyz", self.store.grid.axes(), strict=True))
        return centres[name], self.store.attributes["length_unit"]

    def about(self) -> dict[str, str]:
        """Return attributes that say where a file comes from."""
        versions = self.store.attributes.get("versions") or {}
        return {
            "Conventions": "CF-1.11",
            "title": "3-D emission reconstructed from camera images",
            "source": f"flametomo {versions.get('flametomo', '')}".strip(),
        }


class Format(NamedTuple):
    """A format: what writes it, the suffixes it may have, and the libraries that it needs."""

    writer: str
    suffixes: tuple[str, ...]
    needs: tuple[str, ...]
    help: str


FORMATS = {
    "pvd": Format(
        "volume_files:write_pvd", (".pvd",), (), "a collection for ParaView beside .vti files"
    ),
    "vtkhdf": Format(
        "hdf5:write_vtkhdf", (".vtkhdf", ".hdf"), ("h5py",), "one file for ParaView and VTK"
    ),
    "ome-zarr": Format(
        "ome_zarr:write_ome_zarr", (".zarr",), (), "an OME-Zarr 0.5 image for napari and Fiji"
    ),
    "netcdf": Format("hdf5:write_netcdf", (".nc",), ("h5netcdf",), "one file with coordinates"),
    "npz": Format("volume_files:write_npz", ("",), (), "a folder of NumPy files"),
    "mp4": Format("film:write_film", (".mp4",), ("av",), "the light along lines of sight"),
    "statistics": Format(
        "spectrum:write_statistics", (".zarr",), (), "mean and RMS fluctuation of every voxel"
    ),
    "spectrum": Format(
        "spectrum:write_spectrum", (".zarr",), (), "power spectral density of every voxel"
    ),
}
"""Name to format. A format is a function of a `Frames` and a path in a module of this package,
and a line here."""


def export_series(
    store: SeriesStore,
    target: str | os.PathLike,
    to: str,
    places: Sequence[int] | None = None,
    *,
    progress: Progress | bool | None = None,
) -> Path:
    """Write frames of a store for other programs; memory does not grow with their number.

    Frames that could not be read, which the store marks, are left out.

    Parameters
    ----------
    store : SeriesStore
    target : path-like
        The file, folder or store to write, with the suffix of the format.
    to : str
        One of `FORMATS`.
    places : sequence of int, optional
        Places of frames in the store; all when None.
    progress : bool or callable, optional
        True shows a bar.

    Raises
    ------
    ValueError
        If the format is unknown, the suffix or the length of the series does not suit it, a
        library is missing, or a frame is still to be reconstructed.
    """
    target = Path(target)
    if to not in FORMATS:
        raise ValueError(f"to: found {to!r}, expected one of {', '.join(FORMATS)}")
    chosen = FORMATS[to]
    if target.suffix not in chosen.suffixes and any(chosen.suffixes):
        expected = " or ".join(chosen.suffixes)
        raise ValueError(f"{target}: suffix: found {target.suffix!r}, expected {expected}")
    for library in chosen.needs:
        if find_spec(library) is None:
            raise ValueError(
                f"to: found {to}, which needs the library {library}: install it by "
                "pip install 'flametomo[export]'"
            )
    places = range(store.n_frames) if places is None else places
    store.check_present(places)
    states = store.states
    missing = [place for place in places if not states[place]]
    if missing:
        raise ValueError(
            f"{store.path}: frames: found {len(missing)} that are not complete, the first is "
            f"{missing[0]}: finish them by the command that began the store, or name others"
        )
    chosen_places = tuple(place for place in places if states[place] == COMPLETE)
    if not chosen_places:
        raise ValueError(f"{store.path}: frames: found none that could be read, expected one")
    module, name = chosen.writer.split(":")
    write = getattr(import_module(f"tomo.export.{module}"), name)
    with progress_of(progress, "export") as tell:
        write(Frames(store, chosen_places, tell), target)
    return target
