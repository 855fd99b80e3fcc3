"""Zarr arrays as films, of versions 2 and 3."""

from __future__ import annotations

import itertools
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import ALWAYS_ALLOWED, check_claim, errors_of_libraries
from rigs.recordings.film_formats.npy import ArrayFilm

if TYPE_CHECKING:
    import zarr


class ZarrFilm(ArrayFilm):
    """An array ``(frames, height, width)``; see `Recording`.

    Times are the group's array named as the first dimension, if it has a unit of time, as in
    xarray.
    """

    def __init__(self, path: str | os.PathLike, member: str | None = None) -> None:
        self.path, self._given = Path(path), member
        import zarr

        with errors_of_libraries(f"{self.path}: not a readable Zarr film"):
            opened = zarr.open(self.path, mode="r")
            self._group = opened if isinstance(opened, zarr.Group) else None
            self._hold(self._chosen(opened, member))
            self._check_claims()
            self.timestamps = self._read_times()

    def _opened_by(self) -> tuple:
        return self.path, self._given

    def _stored(self, index: int) -> NDArray:
        self._check_chunks(index)
        return super()._stored(index)

    def _chosen(self, opened: zarr.Array | zarr.Group, member: str | None) -> zarr.Array:
        """Return the array of a name, or the only one that is a film."""
        import zarr

        if member is not None:
            steps = [step for step in member.split("/") if step]
            if ".." in steps or self._group is None:
                raise ValueError(f"found {member!r}, expected the name of an array in a group")
            found = self._group["/".join(steps)]
            if not isinstance(found, zarr.Array):
                raise ValueError(f"found a group {member}, expected an array")
            return found
        if isinstance(opened, zarr.Array):
            return opened
        films = [name for name, one in opened.arrays() if one.ndim == 3]
        if len(films) != 1:
            raise ValueError(
                f"found the arrays {', '.join(films) or 'none'} of shape (frames, height, width), "
                f"expected the path of one, like {self.path.name}:/{films[0] if films else 'data'}"
            )
        return cast("zarr.Array", opened[films[0]])

    @property
    def _folder(self) -> Path:
        return self.path / self._array.path if self._array.path else self.path

    def _check_claims(self) -> None:
        """Raise where a frame, or a chunk of frames, claims far more than the folder holds."""
        item = self._array.dtype.itemsize
        shards = self._array.shards or self._array.chunks
        for sides in (self._array.shape[1:], self._array.chunks, shards):
            claimed = math.prod(sides) * item
            if claimed > ALWAYS_ALLOWED:
                files = (one for one in self._folder.rglob("*") if one.is_file())
                check_claim(claimed, sum(one.stat().st_size for one in files))

    def _check_chunks(self, index: int) -> None:
        """Raise where a part of a frame was never written: Zarr would fill it."""
        sides = self._array.shards or self._array.chunks
        counts = [
            -(-length // side) for length, side in zip(self._array.shape, sides, strict=True)
        ]
        places = itertools.product([index // sides[0]], *(range(count) for count in counts[1:]))
        encoded = self._array.metadata.encode_chunk_key
        for place in places:
            if not (self._folder / encoded(place)).is_file():
                raise ValueError("found a part that was never written, expected a whole frame")

    def _read_times(self) -> NDArray[np.float64] | None:
        """Return the frames' times in seconds, where the group has them."""
        names: Any = getattr(self._array.metadata, "dimension_names", None)
        names = names or self._array.attrs.get("_ARRAY_DIMENSIONS") or [None]
        if self._group is None or not isinstance(names[0], str) or names[0] not in self._group:
            return None
        return self._seconds(self._group[names[0]])
