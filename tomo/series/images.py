"""Frames of a film as they are read; those that cannot be read are left out where asked for."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Literal, overload

from tomo.pipeline.frames import FrameImages, images_of
from tomo.pipeline.load import LoadedScan, load
from tomo.pipeline.options import Options
from tomo.pipeline.screen import ScreenedScan
from tomo.scan import Scan
from tomo.series.frames import key_places


class UnreadableError(ValueError):
    """A frame that cannot be read or decoded.

    Attributes
    ----------
    frame : str
        Its name.
    reason : str
        One line that names the file.
    """

    def __init__(self, frame: str, error: Exception) -> None:
        self.frame, self.reason = frame, " ".join(str(error).split())
        super().__init__(
            f"frame {frame}: {self.reason}; skip_bad=True leaves out frames that cannot be read"
        )


@contextmanager
def naming(frame: str) -> Iterator[None]:
    """Turn what goes wrong in reading a frame's images into an `UnreadableError`."""
    try:
        yield
    except (ValueError, OSError) as error:
        raise UnreadableError(frame, error) from error


@overload
def read_frame(scan: Scan, place: int, skip_bad: Literal[False]) -> LoadedScan: ...
@overload
def read_frame(scan: Scan, place: int, skip_bad: bool) -> LoadedScan | None: ...
def read_frame(scan: Scan, place: int, skip_bad: bool) -> LoadedScan | None:
    """Return a frame by its place in the scan; None where it cannot be read and may be left out.

    Raises
    ------
    UnreadableError
        If it cannot be read or decoded.
    """
    frame = scan.frames[place].name
    try:
        with naming(frame):
            return load(scan, frame)
    except UnreadableError:
        if skip_bad:
            return None
        raise


def reader_of(
    scan: Scan, screened: ScreenedScan, skip_bad: bool = False
) -> Callable[[int], FrameImages | None]:
    """Return what reads a frame by its place in the scan; None for one that is left out."""

    def read(place: int) -> FrameImages | None:
        loaded = read_frame(scan, place, skip_bad)
        return None if loaded is None else images_of(loaded, screened)

    return read


def readable_keys(scan: Scan, places: Sequence[int], options: Options) -> tuple[int, ...]:
    """Return the places of the key frames, see `readable`."""
    return readable(scan, key_places(places, options), places, options.skip_bad)


def readable(
    scan: Scan, wanted: Sequence[int], places: Sequence[int], skip_bad: bool
) -> tuple[int, ...]:
    """Return some of the frames; each bad one gives way to the next that is readable.

    Parameters
    ----------
    scan : Scan
    wanted : sequence of int
        Those frames, by their places in the scan, ascending.
    places : sequence of int
        All frames.
    skip_bad : bool
        Whether frames may be left out; all are returned otherwise.

    Raises
    ------
    ValueError
        If no frame can be read.
    """
    if not skip_bad:
        return tuple(wanted)
    found: list[int] = []
    for key, end in zip(wanted, (*wanted[1:], places[-1] + 1), strict=True):
        stretch = [place for place in places if key <= place < end]
        good = (place for place in stretch if read_frame(scan, place, True) is not None)
        found += itertools.islice(good, 1)
    if not found:
        read_frame(scan, wanted[0], False)  # raises, with the reason
        raise ValueError(f"{scan.where}frames: found none that can be read, expected one")
    return tuple(found)
