"""Arrays as films: those in .npy files, and what is common to other files of arrays."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import errors_of_libraries
from rigs.recordings.recording import Reopened
from rigs.recordings.still import Still

UNITS = {"s": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of times, in seconds."""


class ArrayFilm(Reopened):
    """An array ``(frames, height, width)`` of which a frame is read at a time."""

    def _hold(self, array: Any) -> None:
        """Take an array; refuse one that is no film."""
        self._array = array
        self.n_frames, self.image_size, self.bit_depth = film_shape(array.shape, array.dtype)

    def _stored(self, index: int) -> NDArray:
        """Return a frame as it is stored."""
        return np.asarray(self._array[index])

    def _frame(self, index: int) -> NDArray:
        frame = self._stored(index)
        return frame.astype(frame.dtype.newbyteorder("="), order="C", copy=False)

    def _seconds(self, times: Any) -> NDArray[np.float64] | None:
        """Return the times in a data set, where it has a unit and one for each frame."""
        unit = times.attrs.get("units")
        scale = UNITS.get(unit) if isinstance(unit, str) else None
        if scale is None or getattr(times, "shape", None) != (self.n_frames,):
            return None
        if times.dtype.kind not in "iuf":
            return None
        return np.asarray(times[:]).astype(np.float64) * scale


class NpyFilm(ArrayFilm):
    """An array ``(frames, height, width)`` in a .npy file, mapped and never loaded whole.

    See `Recording`.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        with errors_of_libraries(f"{self.path}: not a readable NumPy array"):
            self._hold(np.load(self.path, mmap_mode="r", allow_pickle=False))

    def _stored(self, index: int) -> NDArray:
        return np.array(self._array[index])  # a frame in memory, no part of the mapped file


def film_shape(shape: tuple[int, ...], dtype: np.dtype) -> tuple[int, tuple[int, int], int | None]:
    """Return the number of frames, image size and bits of an array that is a film."""
    if not isinstance(dtype, np.dtype) or dtype.names or dtype.kind not in "iuf":
        raise ValueError(f"found elements {dtype}, expected integers or floating point")
    if len(shape) != 3 or 0 in shape:
        raise ValueError(f"found shape {shape}, expected (frames, height, width)")
    frames, height, width = (int(side) for side in shape)
    full = Still.of(np.zeros((0, 0), dtype)).full_scale  # refuses integers that are too long
    return frames, (width, height), None if full is None else 8 * dtype.itemsize
