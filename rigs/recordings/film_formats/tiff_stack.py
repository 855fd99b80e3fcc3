"""TIFF files of many pages as a recording: one page a frame."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import errors_of_libraries
from rigs.recordings.recording import Reopened, check_index, check_size, frame_errors
from rigs.recordings.tiff import bits_of, decoded, is_pattern, opened_tiff, silent_log

if TYPE_CHECKING:
    import tifffile


class TiffStack(Reopened):
    """The pages of a TIFF or BigTIFF file, each a grey frame; see `Recording`.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    ValueError
        If the file is no TIFF or has no page.
    """

    frame_rate: float | None = None
    timestamps: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()

    def __init__(self, path: str | os.PathLike) -> None:
        import tifffile

        self.path = Path(path)
        self._lock = threading.Lock()  # the pages share the file's position
        self._bytes = self.path.stat().st_size
        with errors_of_libraries(f"{self.path}: not a readable TIFF"), silent_log("tifffile"):
            self._file = tifffile.TiffFile(self.path)
            self.n_frames = len(self._file.pages)
            if not self.n_frames:
                raise ValueError("found no page, expected frames")
            first = self._file.pages.first
            self.image_size = (first.imagewidth, first.imagelength)
            self.bit_depth = bits_of(first)
            self.is_mosaic = is_pattern(first)

    def read(self, index: int) -> NDArray:
        """Return a frame, see `Recording.read`."""
        check_index(self.path, index, self.n_frames)
        with frame_errors(self.path, index), self._lock, silent_log("tifffile"):
            page = cast("tifffile.TiffPage", self._file.pages.get(index, aspage=True))
            image = decoded(page, self._bytes).grey()
        check_size(self.path, index, image, self.image_size)
        return image

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def is_stack(path: Path) -> bool:
    """Return whether a file is a TIFF whose first two pages are of one size."""
    with contextlib.suppress(Exception), opened_tiff(path) as file:
        first = file.pages[0]
        return file.pages.get(1).shape == first.shape
    return False
