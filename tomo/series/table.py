"""The figures of all frames of a series, read once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.series.layout import CAMERA_FIGURES, FIGURES
from tomo.series.store import SeriesStore


@dataclass(frozen=True, eq=False)
class SeriesTable:
    """The figures of a series.

    Attributes
    ----------
    store : SeriesStore
    frames : (frames,) int64
        Numbers in the scan.
    times : (frames,) float64
    columns : mapping of str to (frames,) or (frames, cameras)
        `FIGURES`, `CAMERA_FIGURES` and ``complete``; NaN where there is none.
    """

    store: SeriesStore
    frames: NDArray[np.int64]
    times: NDArray[np.float64]
    columns: Mapping[str, NDArray]

    @classmethod
    def of(cls, store: SeriesStore) -> SeriesTable:
        """Read the figures of a store."""
        columns = {name: store.values(name) for name in (*FIGURES, *CAMERA_FIGURES)}
        columns["complete"] = store.states
        return cls(store, store.values("frame"), store.values("time"), columns)

    @property
    def cameras(self) -> list[str]:
        """The names of the cameras, in the order of the columns."""
        return self.store.attributes["cameras"]

    def known(self, name: str) -> NDArray[np.float64]:
        """Return the finite values of a figure of frames."""
        values = self.columns[name]
        return values[np.isfinite(values)]

    def each_camera(self, name: str) -> dict[str, NDArray[np.float64]]:
        """Return a figure's column of each camera that has it, NaN where a frame has none."""
        columns = dict(zip(self.cameras, self.columns[name].T, strict=True))
        return {camera: own for camera, own in columns.items() if np.isfinite(own).any()}

    def label(self, place: int) -> str:
        """Return words for a frame: its number, and its time where that is known."""
        unit = self.store.attributes["time_unit"]
        time = "" if unit == "1" else f", {self.times[place]:.6g} {unit}"
        return f"frame {self.frames[place]}{time}"
