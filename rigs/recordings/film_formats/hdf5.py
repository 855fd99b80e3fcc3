"""Data sets in HDF5 files as films, NeXus among them."""

from __future__ import annotations

import itertools
import math
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.files.text import AT_ONCE
from rigs.recordings.film_formats.npy import ArrayFilm
from rigs.recordings.recording import needs

if TYPE_CHECKING:
    import h5py

_MARK = b"GCOL\x01\0\0\0"  # a collection of texts, version 1
_OBJECT = struct.Struct("<HHIQ")  # number, references, reserved, size
_MOST_LISTED = 1000  # objects of a file that are looked at for films


class Hdf5Film(ArrayFilm):
    """A data set ``(frames, height, width)``; see `Recording`.

    Times are the data set that NeXus names first in the group's ``axes``, if it has a unit of
    time.
    """

    def __init__(self, path: str | os.PathLike, member: str | None = None) -> None:
        self.path, self._given = Path(path), member
        h5py = needs("h5py", self.path)
        with errors_of_libraries(f"{self.path}: not a readable HDF5 film"):
            check_heaps(self.path)
            self._file = h5py.File(self.path, "r", locking="best-effort")
            self.member = member or self._only_film()
            self._hold(self._found(self.member))
            self._check_storage()
            self.timestamps = self._read_times()

    def _opened_by(self) -> tuple:
        return self.path, self._given

    def _stored(self, index: int) -> NDArray:
        if self._array.chunks is not None:
            self._check_chunks(index)
        return super()._stored(index)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _only_film(self) -> str:
        """Return the name of the file's only film."""
        found = list(itertools.islice(_films_of(self._file), 5))
        if len(found) == 1:
            return found[0]
        listed = ", ".join(f"{self.path.name}:{name}" for name in found)
        raise ValueError(
            f"found {'no data set' if not found else f'the data sets {listed}'} of shape "
            "(frames, height, width), expected the path of one, like "
            f"{self.path.name}:/entry/data/data"
        )

    def _found(self, name: str) -> h5py.Dataset:
        """Return a data set, refusing links that lead out of the file's folder."""
        import h5py

        group, steps = self._file, [step for step in name.split("/") if step]
        for step in steps:
            if not isinstance(group, h5py.Group) or step not in group:
                raise ValueError(f"found no {step!r} of {name}, expected a data set")
            link = group.get(step, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                self._check_inside(link.filename)
            group = group[step]
        if not isinstance(group, h5py.Dataset):
            raise ValueError(f"found a group {name}, expected a data set")
        return group

    def _check_inside(self, other: str) -> None:
        """Raise where a file that this one names is not in its folder or below."""
        folder = self.path.parent.resolve()
        if other != "." and not (folder / other).resolve().is_relative_to(folder):
            raise ValueError(f"found data in {other!r}, expected them in the folder of the film")

    def _check_storage(self) -> None:
        """Raise where data lie outside, or a frame would take far more memory than it holds."""
        if self._array.external:
            raise ValueError("found data stored in other files, expected them in the film")
        held = self.path.stat().st_size
        if self._array.is_virtual:
            for source in self._array.virtual_sources():
                self._check_inside(source.file_name)
                other = self.path.parent / source.file_name
                held += other.stat().st_size if other.is_file() else 0
        if not self._array.is_virtual and self._array.id.get_storage_size() == 0:
            raise ValueError(f"found nothing written in {self.member}, expected frames")
        sides = self._array.chunks or self._array.shape[1:]
        check_claim(math.prod(sides) * self._array.dtype.itemsize, held)
        check_claim(math.prod(self._array.shape[1:]) * self._array.dtype.itemsize, held)

    def _check_chunks(self, index: int) -> None:
        """Raise where a part of a frame was never written: HDF5 would fill it."""
        sides = self._array.chunks
        starts = [
            range(index // sides[0] * sides[0], index + 1, sides[0]),
            *(
                range(0, length, side)
                for length, side in zip(self._array.shape[1:], sides[1:], strict=True)
            ),
        ]
        for place in itertools.product(*starts):
            if self._array.id.get_chunk_info_by_coord(place).byte_offset is None:
                raise ValueError("found a part that was never written, expected a whole frame")

    def _read_times(self) -> NDArray[np.float64] | None:
        """Return the frames' times in seconds, where NeXus's axes name them."""
        axes = np.atleast_1d(self._array.parent.attrs.get("axes", [])).tolist()
        name = axes[0] if axes and isinstance(axes[0], str) else None
        if name is None or name not in self._array.parent:
            return None
        return self._seconds(self._found(f"{self._array.parent.name}/{name}"))


def _films_of(file: h5py.File) -> Iterator[str]:
    """Yield the names of data sets that are films, in the file's order; links are not followed."""
    import h5py

    waiting, seen = [(file, "")], 0
    while waiting:
        group, place = waiting.pop(0)
        for name in group:
            seen += 1
            if seen > _MOST_LISTED:
                return
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            one = group[name]
            if isinstance(one, h5py.Group):
                waiting.append((one, f"{place}/{name}"))
            elif isinstance(one, h5py.Dataset) and _is_film(one):
                yield f"{place}/{name}"


def _is_film(one: h5py.Dataset) -> bool:
    return one.dtype.kind in "iuf" and len(one.shape or ()) == 3 and 0 not in one.shape


def check_heaps(path: str | os.PathLike) -> None:
    """Raise where a collection of texts at either end of a file cannot be walked through.

    "HDF5 File Format Specification", III.E. Objects are filled up to eight bytes; object 0 is the
    free space, its size includes its head.
    """
    with open(path, "rb") as file:
        held = file.seek(0, os.SEEK_END)
        for start in {0, max(0, held - AT_ONCE)}:
            file.seek(start)
            content = file.read(AT_ONCE)
            at = content.find(_MARK)
            while at >= 0:
                _check_heap(content[at : at + (1 << 16)], start + at)
                at = content.find(_MARK, at + len(_MARK))


def _check_heap(content: bytes, place: int) -> None:
    """Raise unless the sizes of a collection's objects lead to its end."""
    if len(content) < 16:
        raise ValueError(f"found a collection of texts at byte {place} that ends at once: damaged")
    (size,) = struct.unpack_from("<Q", content, 8)
    at = 16
    while at + _OBJECT.size <= min(size, len(content)):
        number, _, _, length = _OBJECT.unpack_from(content, at)
        step = length if number == 0 else _OBJECT.size + length + -length % 8
        if step < _OBJECT.size or at + step > size:
            raise ValueError(f"found a text at byte {place + at} of {length} bytes: damaged")
        at += step
