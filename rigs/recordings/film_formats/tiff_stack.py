"""TIFF files of many pages as a recording: a page a frame, or one for each of its channels."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import errors_of_libraries
from rigs.recordings import tiff_planes
from rigs.recordings.recording import Reopened, check_index, check_size, frame_errors
from rigs.recordings.still import CHANNELS, Still
from rigs.recordings.tiff import bits_of, decoded, is_pattern, opened_tiff, silent_log
from rigs.recordings.tiff_planes import planes_of

if TYPE_CHECKING:
    import tifffile


class TiffStack(Reopened):
    """The pages of a TIFF or BigTIFF file; see `Recording`."""

    def __init__(self, path: str | os.PathLike) -> None:
        import tifffile

        self.path = Path(path)
        self._lock = threading.Lock()  # the pages share the file's position
        self._bytes = self.path.stat().st_size
        with errors_of_libraries(f"{self.path}: not a readable TIFF"), silent_log():
            self._file = tifffile.TiffFile(self.path)
            self._planes = planes_of(self._file)
            self.n_frames = len(self._planes.pages)
            self.channels = self._planes.channels
            self.notes = (self._planes.note,) if self._planes.note else ()
            first = self._file.pages.first
            self.image_size = (first.imagewidth, first.imagelength)
            self.bit_depth = bits_of(first)
            if self._planes.is_one_block:
                decoded(first, self._bytes)  # whether its header is that of intensities
            self.is_mosaic = is_pattern(first)

    def read(self, index: int) -> NDArray:
        """Return a frame, see `Recording.read`."""
        return self.read_channel(index, None)

    def read_channel(self, index: int, channel: str | None) -> NDArray:
        """Return a channel of a frame, see `Recording.read_channel`."""
        check_index(self.path, index, self.n_frames)
        with frame_errors(self.path, index), self._lock, silent_log():
            plane = self._planes.pages[index, self._channel(channel)]
            colour = channel if len(self.channels) == 1 else None
            still = self._still(int(plane))
            if colour is not None and (still.is_grey or colour not in CHANNELS):
                known = "none: frames are grey" if still.is_grey else ", ".join(CHANNELS)
                raise ValueError(f"channel: found {colour!r}, expected {known}")
            image = still.grey(colour)
        check_size(self.path, index, image, self.image_size)
        return image

    def _channel(self, asked: str | None) -> int:
        """Return the place of a channel; without several, any colour is one of a page."""
        count = len(self.channels)
        if count == 1:
            return 0
        if asked is None or asked not in map(str, range(count)):
            found = f"found {asked!r}" if asked is not None else "found none"
            names = "" if self.channels[0] == "0" else f" ({', '.join(self.channels)})"
            raise ValueError(
                f"channel: {found}, expected 0 to {count - 1}, one of the file's {count} "
                f"channels{names}: --channel 0, or corrections: {{channel: 0}} in scan.yaml, or "
                "one stored alone"
            )
        return int(asked)

    def _still(self, plane: int) -> Still:
        """Return a page's image, or that of values without a page of their own."""
        if not self._planes.is_one_block:
            page = cast("tifffile.TiffPage", self._file.pages.get(plane, aspage=True))
            return decoded(page, self._bytes)
        page = self._file.pages.first
        self._file.filehandle.seek(page.dataoffsets[0] + plane * page.nbytes)
        stored = np.dtype(page.dtype).newbyteorder(self._file.byteorder)
        values = np.frombuffer(self._file.filehandle.read(page.nbytes), stored)
        return Still.of(values.reshape(page.shape).astype(page.dtype), bits_of(page))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def is_stack(path: Path) -> bool:
    """Return whether a file is a TIFF whose first two pages are of one size, or one cut short."""
    with contextlib.suppress(Exception), opened_tiff(path) as file:
        return tiff_planes.is_stack(file)
    return False
