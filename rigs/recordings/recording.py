"""Recordings: the frames of one camera, behind one protocol whatever the format.

Times of films against each other: cameras that started late, or lost frames.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class FrameError(ValueError):
    """One frame of a recording cannot be decoded, though others may.

    Parameters
    ----------
    path : path-like
        The file.
    frame : int or None
        The frame's number in it, from 0; None where the file is one frame.
    reason : str
        Text in one line: found, and expected.
    """

    def __init__(self, path: str | os.PathLike, frame: int | None, reason: str) -> None:
        super().__init__(path, frame, reason)  # what a pickle calls it with again
        self.path, self.frame, self.reason = Path(path), frame, reason

    def __str__(self) -> str:
        place = "" if self.frame is None else f"frame {self.frame}: "
        return f"{self.path}: {place}{self.reason}"


class Recording(Protocol):
    """The frames of one camera: opened in little time, and read when asked for, in any order.

    Several threads may read at once. Pixels are as stored, row 0 first. A copy in another process,
    by pickle, opens the file again.

    Attributes
    ----------
    n_frames : int
    image_size : (int, int)
        Width and height in pixels, of every frame.
    bit_depth : int or None
        Bits that were recorded of a pixel; None for floating-point numbers.
    frame_rate : float or None
        Frames a second, where the file says.
    timestamps : (n_frames,) float64 or None
        Seconds from the trigger, or from the first frame where the format knows no trigger; None
        where the file does not say.
    notes : tuple of str
        Lines that a user should know of the numbers, such as that they are not linear in light.
    is_mosaic : bool
        Whether the file says that neighbouring pixels have filters of different colours.
    channels : tuple of str
        Names of the images that were recorded at each moment: filters, dyes. Where there are
        several, `read_channel` takes the number of one.
    """

    n_frames: int
    image_size: tuple[int, int]
    bit_depth: int | None
    frame_rate: float | None
    timestamps: NDArray[np.float64] | None
    notes: tuple[str, ...]
    is_mosaic: bool
    channels: tuple[str, ...]

    def read(self, index: int) -> NDArray:
        """Return a frame ``(height, width)``, from 0; a FrameError names file and frame."""

    def read_channel(self, index: int, channel: str | None) -> NDArray:
        """Return one channel of a frame, by its number or r, g, b; the frame itself for None."""


def check_index(path: Path, index: int, n_frames: int) -> None:
    """Raise unless a recording has a frame; negative numbers name none."""
    if not 0 <= index < n_frames:
        raise IndexError(f"{path}: found frame {index}, expected 0 to {n_frames - 1}")


@contextmanager
def frame_errors(path: Path, index: int) -> Iterator[None]:
    """Turn any exception over a frame's bytes into one line that names file and frame."""
    try:
        yield
    except FrameError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, OSError) and error.strerror:
            reason = f"cannot be read: {error.strerror}"
        raise FrameError(path, index, reason.removeprefix(f"{path}: ")) from None


def needs(package: str, path: Path) -> ModuleType:
    """Return a package that an extra installs."""
    try:
        return importlib.import_module(package)
    except ImportError:
        raise ValueError(
            f"{path}: reading it needs the package {package}, which is not installed: pip install "
            "'flametomo[films]'"
        ) from None


class Reopened:
    """A recording that a pickle opens again: what `_opened_by` names is called once more."""

    path: Path
    n_frames: int
    image_size: tuple[int, int]
    frame_rate: float | None = None
    timestamps: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()
    is_mosaic: bool = False
    channels: tuple[str, ...] = ("0",)

    def _opened_by(self) -> tuple:
        """Return what the class was called with."""
        return (self.path,)

    def read(self, index: int) -> NDArray:
        """Return a frame, see `Recording.read`."""
        check_index(self.path, index, self.n_frames)
        with frame_errors(self._path_of(index), index):
            image = self._frame(index)
            check_size(self._path_of(index), index, image, self.image_size)
            return image

    def _path_of(self, index: int) -> Path:
        """Return the file of a frame."""
        return self.path

    def _frame(self, index: int) -> NDArray:
        """Return a frame that there is; errors get the file and the number."""
        raise NotImplementedError

    def read_channel(self, index: int, channel: str | None) -> NDArray:
        """Return a frame of a format without channels, see `Recording.read_channel`."""
        if channel is not None:
            raise FrameError(self.path, index, f"channel: found {channel!r}, expected none")
        return self.read(index)

    def __reduce__(self) -> tuple:
        return type(self), self._opened_by()

    def __repr__(self) -> str:
        found = (str(one) if isinstance(one, Path) else one for one in self._opened_by())
        return f"{type(self).__name__}({', '.join(map(repr, found))})"


def check_size(path: Path, index: int, image: NDArray, size: tuple[int, int]) -> None:
    """Raise unless a frame has the size of the first."""
    if image.shape[::-1] != size:
        raise FrameError(
            path,
            index,
            f"found {image.shape[1]} x {image.shape[0]} pixels, expected {size[0]} x {size[1]}, "
            "as in the first",
        )


@dataclass(frozen=True)
class OffBeat:
    """A film whose images are late by ``frames`` of its own, the middle of all differences.

    ``where`` is the first frame compared that is off by another number (frames were lost, or
    clocks run at different speeds); None where all are off alike.
    """

    camera: str
    frames: int
    where: int | None = None


def off_beat(
    times: Mapping[str, NDArray[np.float64]], periods: Mapping[str, float]
) -> list[OffBeat]:
    """Return the films whose frames were not recorded when the others' were.

    ``times`` are each camera's of as many frames, seconds, ``periods`` those from frame to frame.
    A film is compared with the median of all films' times, frame by frame; of two films the first
    is taken to be right. A difference of less than half the film's period is none.

    >>> import numpy as np
    >>> beat = np.arange(5) / 100
    >>> times = {"a": beat, "b": beat, "c": beat + 0.02}
    >>> off_beat(times, dict.fromkeys(times, 0.01))
    [OffBeat(camera='c', frames=2, where=None)]
    """
    each = np.array([times[name] for name in times])
    if len(each) < 2 or not each.size or not np.isfinite(each).all():
        return []
    common = np.median(each, axis=0) if len(each) > 2 else each[0]
    found = []
    for name, own in zip(times, each, strict=True):
        late = (own - common) / periods[name]
        middle = float(np.median(late))
        frames = round(middle)
        others = np.flatnonzero(np.rint(late - frames))
        if frames or others.size:
            found.append(OffBeat(name, frames, int(others[0]) if others.size else None))
    return found
