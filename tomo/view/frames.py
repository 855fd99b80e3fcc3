"""The volumes of a film, read one at a time; a few are kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

MOST_BYTES = 256_000_000
"""Bytes of volumes kept. Lower: going back in a film reads again; higher: memory."""

SCALE_FRAMES = 5
"""Frames that the common scale of a film is taken from: reading all would take minutes."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a film, or the one of a still volume.

    Attributes
    ----------
    names : tuple of str
        One a frame, as it is shown.
    read : callable
        From a frame's place in ``names`` to its volume, ``(nx, ny, nz)``.
    most_bytes : int
        Of volumes kept besides the last one.
    """

    names: tuple[str, ...]
    read: Callable[[int], NDArray]
    most_bytes: int = MOST_BYTES
    _kept: OrderedDict = field(default_factory=OrderedDict, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.names)

    def volume(self, place: int) -> NDArray[np.float32]:
        """Return the volume of a frame, 0 where it has no finite value.

        Raises
        ------
        ValueError
            If the frame cannot be read.
        """
        kept = self._kept
        if place not in kept:
            read = np.ascontiguousarray(self.read(place), np.float32)
            volume = np.nan_to_num(read, nan=0.0, posinf=0.0, neginf=0.0)
            while kept and sum(one.nbytes for one in kept.values()) + volume.nbytes > (
                self.most_bytes
            ):
                kept.popitem(last=False)
            kept[place] = volume
        kept.move_to_end(place)
        return kept[place]

    def spread(self) -> Sequence[int]:
        """Return the places of a few frames spread over the film, the first one last."""
        count = min(len(self), SCALE_FRAMES)
        return sorted({round(at) for at in np.linspace(0, len(self) - 1, count)}, reverse=True)
