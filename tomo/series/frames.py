"""The frames that are asked for, and the blocks in which they are solved."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence

from tomo.pipeline.options import Options
from tomo.scan import Scan

BLOCK = 8
"""Frames of a block, which start from its middle one. More: starts lie further away. Fewer: more
of the time goes into tracing a block and solving its first frame. Results depend on it."""

_SLICE = re.compile(r"(-?\d{0,9}):(-?\d{0,9})(?::(\d{0,9}))?", re.ASCII)


def choose_frames(scan: Scan, text: str) -> tuple[int, ...]:
    """Return the places, in ``scan.frames``, of the frames asked for, ascending.

    Parameters
    ----------
    scan : Scan
    text : str
        Slices of frame numbers as Python writes them, like ``0:1000:2`` or ``:``, and names of
        frames, with commas between them. Frames are numbered from 0.

    Raises
    ------
    ValueError
        If a part is no slice and no frame's name, reaches past the last frame, holds no frame,
        or one frame is asked for twice.
    """
    places = {name: place for place, name in enumerate(scan.frame_names)}
    return slices_of(text, len(places), lambda name: places[scan.frame(name).name])


def slices_of(text: str, count: int, named: Callable[[str], int] | None = None) -> tuple[int, ...]:
    """Return the places that slices, and names where there is who knows them, stand for.

    Raises
    ------
    ValueError
        See `choose_frames`.
    """
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
    """Return the blocks of so many frames, fixed whoever solves them: each a range of places.

    >>> blocks_of(10)
    [range(0, 8), range(8, 10)]
    """
    return [range(start, min(start + BLOCK, count)) for start in range(0, count, BLOCK)]


def key_of(places: Sequence[int]) -> int:
    """Return the place of a block's key frame, the middle one of its places."""
    return places[len(places) // 2]


def spread(count: int, wanted: int) -> tuple[int, ...]:
    """Return the places of ``wanted`` frames spread evenly over ``count``; all where it has fewer.

    >>> spread(40, 3)
    (6, 20, 33)
    """
    wanted = min(count, wanted)
    return tuple((2 * place + 1) * count // (2 * wanted) for place in range(wanted))


def key_places(places: Sequence[int], options: Options) -> tuple[int, ...]:
    """Return the places in the scan of the key frames of a series."""
    return tuple(places[one] for one in spread(len(places), options.key_frames))


def refining_places(places: Sequence[int], options: Options) -> tuple[int, ...]:
    """Return the places in the scan of the frames that cameras are refined from."""
    return tuple(places[one] for one in spread(len(places), options.refine_frames))
