"""NumPy arrays as films."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import errors_of_libraries
from rigs.recordings.recording import Reopened, check_index, frame_errors
from rigs.recordings.still import Still


class NpyFilm(Reopened):
    """An array ``(frames, height, width)`` in a .npy file, mapped and never loaded whole.

    See `Recording`.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    ValueError
        If the file holds no such array of numbers, or Python objects.
    """

    frame_rate: float | None = None
    timestamps: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        with errors_of_libraries(f"{self.path}: not a readable NumPy array"):
            self._array = np.load(self.path, mmap_mode="r", allow_pickle=False)
            self.n_frames, self.image_size, self.bit_depth = film_shape(
                self._array.shape, self._array.dtype
            )

    def read(self, index: int) -> NDArray:
        """Return a frame, see `Recording.read`."""
        check_index(self.path, index, self.n_frames)
        with frame_errors(self.path, index):
            frame = self._array[index]
            return frame.astype(frame.dtype.newbyteorder("="), order="C")


def film_shape(shape: tuple[int, ...], dtype: np.dtype) -> tuple[int, tuple[int, int], int | None]:
    """Return the number of frames, image size and bits of an array that is a film.

    Raises
    ------
    ValueError
        If it is none.
    """
    if not isinstance(dtype, np.dtype) or dtype.names or dtype.kind not in "iuf":
        raise ValueError(f"found elements {dtype}, expected integers or floating point")
    if len(shape) != 3 or 0 in shape:
        raise ValueError(f"found shape {shape}, expected (frames, height, width)")
    frames, height, width = (int(side) for side in shape)
    full = Still.of(np.zeros((0, 0), dtype)).full_scale  # refuses integers that are too long
    return frames, (width, height), None if full is None else 8 * dtype.itemsize
