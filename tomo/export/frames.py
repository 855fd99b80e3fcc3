"""The frames of a store that are exported, one in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.grid import Volume
from tomo.operators.system import Progress
from tomo.series.store import SeriesStore

LARGEST_CHUNK = 1 << 30
"""Bytes of a chunk of a file, at the most: HDF5 takes 4 GiB, readers hold a few in memory."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of a store.

    Attributes
    ----------
    store : SeriesStore
    places : tuple of int
        Their places in the store.
    progress : callable, optional
        ``progress(done, total, where)``.
    """

    store: SeriesStore
    places: tuple[int, ...]
    progress: Progress | None = None

    def __len__(self) -> int:
        return len(self.places)

    @cached_property
    def times(self) -> NDArray[np.float64]:
        """When they were taken, ``(frames,)``, in the store's ``time_unit``."""
        return self.of("time")

    @cached_property
    def numbers(self) -> NDArray[np.int64]:
        """Their numbers in the scan, ``(frames,)``."""
        return self.of("frame")

    def of(self, name: str) -> NDArray:
        """Return their part of an array of the store."""
        return self.store.values(name)[list(self.places)]

    def volumes(self, words: str = "") -> Iterator[Volume]:
        """Yield their volumes ``(nx, ny, nz)``, one after the other."""
        for done, place in enumerate(self.places):
            if self.progress:
                self.progress(done, len(self), f"{words}frame {place}")
            yield self.store.volume(place)
        if self.progress:
            self.progress(len(self), len(self), "")

    def chunk(self) -> tuple[int, int, int]:
        """Return the shape of a chunk of a frame, ``(nx, ny, nz)``: whole, or some planes of x."""
        nx, ny, nz = self.store.grid.shape
        return min(nx, max(LARGEST_CHUNK // (4 * ny * nz), 1)), ny, nz

    def axis(self, name: str) -> tuple[NDArray[np.float64], str]:
        """Return the centres of voxels along ``x``, ``y`` or ``z``, and their unit."""
        centres = dict(zip("xyz", self.store.grid.axes(), strict=True))
        return centres[name], self.store.attributes["length_unit"]

    def about(self) -> dict[str, str]:
        """Return attributes that say where a file comes from."""
        versions = self.store.attributes.get("versions") or {}
        return {
            "Conventions": "CF-1.11",
            "title": "3-D emission reconstructed from camera images",
            "source": f"flametomo {versions.get('flametomo', '')}".strip(),
        }
