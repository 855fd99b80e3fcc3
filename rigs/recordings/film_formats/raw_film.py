"""Binary films without a header of their own, described by the user."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.recordings.recording import Reopened, check_index, frame_errors
from rigs.recordings.stored_pixels import (
    BYTE_ORDERS,
    PIXEL_TYPES,
    bytes_of,
    pixels_of,
    read_part,
)


@dataclass(frozen=True)
class RawLayout:
    """Where the frames lie in a binary file, and how their pixels are stored.

    Parameters
    ----------
    width, height : int
        Pixels.
    dtype : str
        One of `PIXEL_TYPES`; ``uint10`` and ``uint12`` are packed without gaps.
    byte_order : {"little", "big"}
    header_bytes : int
        Bytes before the first frame.
    gap_bytes : int
        Bytes from the end of a frame to the next.

    Raises
    ------
    ValueError
        If a value is out of its range.

    Examples
    --------
    >>> RawLayout(1024, 512, "uint12").frame_bytes
    786432
    """

    width: int
    height: int
    dtype: str
    byte_order: str = "little"
    header_bytes: int = 0
    gap_bytes: int = 0

    def __post_init__(self) -> None:
        """Check every value."""
        for name, least in (("width", 1), ("height", 1), ("header_bytes", 0), ("gap_bytes", 0)):
            value = getattr(self, name)
            if value < least:
                raise ValueError(f"{name}: found {value}, expected {least} or more")
        for name, known in (("dtype", PIXEL_TYPES), ("byte_order", BYTE_ORDERS)):
            value = getattr(self, name)
            if value not in known:
                raise ValueError(f"{name}: found {value!r}, expected one of {', '.join(known)}")

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame."""
        return bytes_of(self.dtype, self.width * self.height)

    def start_of(self, index: int) -> int:
        """Return where a frame begins in the file, in bytes."""
        return self.header_bytes + index * (self.frame_bytes + self.gap_bytes)


class RawFilm(Reopened):
    """The frames in a binary file; see `Recording`.

    Parameters
    ----------
    path : path-like
    layout : RawLayout

    Raises
    ------
    ValueError
        If the file does not end with a frame, or with the gap after one.
    """

    frame_rate: float | None = None
    timestamps: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()

    def __init__(self, path: str | os.PathLike, layout: RawLayout) -> None:
        self.path, self.layout = Path(path), layout
        self.image_size = (layout.width, layout.height)
        is_integer = not layout.dtype.startswith("float")
        self.bit_depth = bytes_of(layout.dtype, 8) if is_integer else None
        held = self.path.stat().st_size
        step = layout.frame_bytes + layout.gap_bytes
        self.n_frames, rest = divmod(held - layout.header_bytes + layout.gap_bytes, step)
        if self.n_frames < 1 or rest not in (0, layout.gap_bytes):
            raise ValueError(
                f"{self.path}: found {held} bytes, expected {layout.header_bytes} before frames "
                f"of {layout.frame_bytes} bytes with {layout.gap_bytes} between them: check the "
                "description of the raw film, or the file is truncated"
            )

    def _opened_by(self) -> tuple:
        return self.path, self.layout

    def read(self, index: int) -> NDArray:
        """Return a frame, see `Recording.read`."""
        check_index(self.path, index, self.n_frames)
        with frame_errors(self.path, index):
            data = read_part(self.path, self.layout.start_of(index), self.layout.frame_bytes)
            return pixels_of(data, self.image_size, self.layout.dtype, self.layout.byte_order)
