"""Frames: the images of one moment, and finding one by its name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tomo.scan.image_source import ImageSource


@dataclass(frozen=True)
class Frame:
    """One moment.

    Attributes
    ----------
    name : str
    images : mapping
        Camera name to image file, to a frame of a film, or to an image ``(h, w)`` in memory.
    """

    name: str
    images: Mapping[str, ImageSource]


def find_frame(frames: Sequence[Frame], name: str) -> Frame | None:
    """Return the one frame of a name, of a number at its end, or of another end.

    None where the first of these that fits any frame fits more than one, or nothing fits.
    """
    ways = (
        lambda frame: frame.name == name,
        lambda frame: _last_number(frame.name) == _last_number(name) and name.isdecimal(),
        lambda frame: name != "" and frame.name.endswith(name),
    )
    for is_meant in ways:
        found = [frame for frame in frames if is_meant(frame)]
        if found:
            return found[0] if len(found) == 1 else None
    return None


def _last_number(name: str) -> int | None:
    """Return the number that a name ends with; None where it ends otherwise."""
    digits = re.search(r"[0-9]+$", name)
    return int(digits[0]) if digits else None
