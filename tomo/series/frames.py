"""The frames that are asked for, and the blocks in which they are solved.

Frames that cannot be read are left out where that is asked for.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

from tomo.pipeline.load import LoadedScan, load
from tomo.pipeline.options import Options
from tomo.pipeline.screen import FrameImages, ScreenedScan, images_of
from tomo.scan import Scan

BLOCK = 8
"""Frames of a block, which start from its middle one. More: starts lie further away. Fewer: more
of the time goes into tracing a block and solving its first frame. Results depend on it."""

_SLICE = re.compile(r"(-?\d{0,9}):(-?\d{0,9})(?::(\d{0,9}))?", re.ASCII)


def choose_frames(scan: Scan, text: str) -> tuple[int, ...]:
    """Return the places, in ``scan.frames``, of the frames asked for, ascending, each once.

    ``text`` has slices of frame numbers from 0 as Python writes them, like ``0:1000:2`` or ``:``,
    and names of frames, with commas between them.
    """
    places = {name: place for place, name in enumerate(scan.frame_names)}
    return slices_of(text, len(places), lambda name: places[scan.frame(name).name])


def slices_of(text: str, count: int, named: Callable[[str], int] | None = None) -> tuple[int, ...]:
    """Return the places that slices, and names where there is who knows them, stand for."""
    found: list[int] = []
    for part in (one.strip() for one in text.split(",")):
        match = _SLICE.fullmatch(part)
        if match is not None:
            found += _of_slice(match, part, count)
        elif named is not None:
            found.append(named(part))
        else:
            raise ValueError(f"frames: found {part!r}, expected a slice like 0:1000:2")
    chosen = tuple(sorted(found))
    for one, other in itertools.pairwise(chosen):
        if one == other:
            raise ValueError(f"frames: found frame {one} twice in {text!r}, expected it once")
    return chosen


def _of_slice(match: re.Match, part: str, count: int) -> range:
    start, stop, step = (int(one) if one else None for one in match.groups())
    if step == 0:
        raise ValueError(f"frames: found step 0 in {part!r}, expected 1 or more")
    for bound in (start, stop):
        if bound is not None and not -count <= bound <= count:
            raise ValueError(
                f"frames: found {part!r}, expected numbers up to {count}, as many as there are "
                "frames; without its end a slice reaches to the last one"
            )
    found = range(count)[slice(start, stop, step)]
    if not found:
        raise ValueError(f"frames: found {part!r}, which holds none of {count} frames")
    return found


def blocks_of(count: int) -> list[range]:
    """Return the blocks of so many frames, fixed whoever solves them: each a range of places."""
    return [range(start, min(start + BLOCK, count)) for start in range(0, count, BLOCK)]


def spread(count: int, wanted: int) -> tuple[int, ...]:
    """Return the places of ``wanted`` frames spread evenly over ``count``; all where it has fewer.

    >>> spread(40, 3)
    (6, 20, 33)
    """
    wanted = min(count, wanted)
    return tuple((2 * place + 1) * count // (2 * wanted) for place in range(wanted))


class UnreadableError(ValueError):
    """A frame that cannot be read or decoded."""

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


def read_frame(scan: Scan, place: int) -> LoadedScan:
    """Return a frame by its place."""
    frame = scan.frames[place].name
    with naming(frame):
        return load(scan, frame)


def _read_good(scan: Scan, place: int) -> LoadedScan | None:
    with suppress(UnreadableError):
        return read_frame(scan, place)
    return None


def reader_of(
    scan: Scan, screened: ScreenedScan, skip_bad: bool = False
) -> Callable[[int], FrameImages | None]:
    """Return what reads a frame by its place in the scan; None for one that is left out."""

    def read(place: int) -> FrameImages | None:
        loaded = _read_good(scan, place) if skip_bad else read_frame(scan, place)
        return None if loaded is None else images_of(loaded, screened)

    return read


def readable_keys(scan: Scan, places: Sequence[int], options: Options) -> tuple[int, ...]:
    """Return the places of the key frames; each bad one gives way to the next that is readable."""
    wanted = tuple(places[one] for one in spread(len(places), options.key_frames))
    if not options.skip_bad:
        return wanted
    found: list[int] = []
    for key, end in zip(wanted, (*wanted[1:], places[-1] + 1), strict=True):
        stretch = [place for place in places if key <= place < end]
        good = (place for place in stretch if _read_good(scan, place) is not None)
        found += itertools.islice(good, 1)
    if not found:
        read_frame(scan, wanted[0])  # raises, with the reason
        raise ValueError(f"{scan.where}frames: found none that can be read, expected one")
    return tuple(found)
