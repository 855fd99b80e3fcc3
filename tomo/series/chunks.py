"""The chunks of a store's arrays: which file holds which frames, read with the damage named."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray

from rigs.files.atomic import flush
from tomo.io.volume_film import chunk_file, has_checksums, reading_chunk
from tomo.series.layout import COORDINATES


class Chunks:
    """Arrays over time that are read and written in whole chunks along their first axis."""

    def __init__(self, path: Path, arrays: Mapping[str, zarr.Array]) -> None:
        self._path, self.arrays = path, arrays
        self.have_checksums = has_checksums(arrays["emission"])

    def read(self, name: str, places: range, *, needed: bool = True) -> NDArray:
        """Return the part of an array at places that lie in one chunk, written if ``needed``.

        Stores without checksums have no files of chunks that hold the fill value alone.
        """
        array = self.arrays[name]
        file = self.file(name, places.start // array.chunks[0])
        words = f"frame {places.start}"
        if len(places) > 1:
            words = f"frames {places.start} to {places.stop - 1}"
        if name in COORDINATES:
            words = "all frames"
        needed = needed and (self.have_checksums or name == "emission")
        with reading_chunk(file, words, needed=needed):
            return np.asarray(array[places.start : places.stop])

    def values(self, name: str, written: NDArray[np.bool_] | None = None) -> NDArray:
        """Return the numbers of an array; those of places ``written``, or all, must be there."""
        array = self.arrays[name]
        step, count = array.chunks[0], array.shape[0]
        parts = [range(start, min(start + step, count)) for start in range(0, count, step)]
        with suppress(Exception):  # said below, by the file that is damaged
            if all(file.is_file() for file in self.files(name, range(count))):
                return np.asarray(array[:])  # much faster than chunk by chunk
        found = np.zeros(array.shape, array.dtype)
        for part in parts:
            needed = written is None or bool(written[part.start : part.stop].any())
            found[part.start : part.stop] = self.read(name, part, needed=needed)
        return found

    def write(self, name: str, places: range, values: ArrayLike) -> None:
        """Write the part of an array at places that fill chunks: what was there is not read."""
        array = self.arrays[name]
        array[places.start : places.stop] = np.asarray(values, array.dtype)

    def file(self, name: str, chunk: int) -> Path:
        """Return the file of a chunk of an array."""
        return chunk_file(self._path, self.arrays[name], chunk)

    def files(self, name: str, places: range) -> list[Path]:
        """Return the files of the chunks that hold some places of an array."""
        step = self.arrays[name].chunks[0]
        chunks = range(places.start // step, -(-places.stop // step))
        return [self.file(name, chunk) for chunk in chunks]

    def flush(self, files: Sequence[Path]) -> None:
        """Return once files are on the disk under their names."""
        folders = {folder for file in files for folder in file.parents} - {*self._path.parents}
        flush([*files, *sorted(folders, key=lambda folder: -len(folder.parts))])

    def remove_partial(self, names: Iterable[str], places: range) -> None:
        """Remove what a killed process left half-written of the chunks of some places."""
        for name in names:
            for file in self.files(name, places):
                for left in file.parent.glob(f"{file.name}.*.partial"):
                    left.unlink(missing_ok=True)
