"""A film in a page: the volumes of a bounded number of frames, a slider, a button that plays."""

from __future__ import annotations

from collections.abc import Iterable

from numpy.typing import NDArray

from tomo.draw.stage import Shown, fitting
from tomo.grid import VoxelGrid

MOST_FRAMES = 60
"""Frames of a film in a page; they share `tomo.draw.stage.MOST_VOXELS`."""


def film_of(
    moments: Iterable[tuple[str, float, NDArray]],
    count: int,
    grid: VoxelGrid,
    value_unit: str = "",
) -> Shown:
    """Return the film that a page shows.

    Parameters
    ----------
    moments : iterable of (label, position, volume)
        Frames in their order; the position along the time axis is 0 to 1.
    count : int
        How many there are: the more, the coarser.
    grid : VoxelGrid
    value_unit : str

    Raises
    ------
    ValueError
        If there is no frame.
    """
    labels, frames, small = [], [], grid
    for label, position, volume in moments:
        frame, small = fitting(volume, grid, count)
        labels.append((label, round(position, 5)))
        frames.append(frame)
    if not frames:
        raise ValueError("film: found no frame, expected one")
    return Shown(frames, small, value_unit, labels, whole=grid)
