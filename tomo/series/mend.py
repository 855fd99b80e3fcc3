"""Frames of a store that are recorded as done but damaged: recorded as to be done again."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from rigs.progress import Progress
from tomo.grid import VoxelGrid
from tomo.series.frames import blocks_of
from tomo.series.same_run import Claims
from tomo.series.store import SeriesStore

logger = logging.getLogger(__name__)


def mend(
    store: SeriesStore,
    times: Sequence[float],
    frames: Sequence[int],
    progress: Progress | None = None,
) -> None:
    """Read a store through, and have a run do again what is damaged in it.

    Coordinates are written again. Frames that cannot be read are recorded as to be done; those
    beside them stay complete meanwhile. A block that another run has in hand is left to it.

    Parameters
    ----------
    store : SeriesStore
        Its attributes are those of the run.
    times, frames : sequence
        As for `SeriesStore.create`.
    progress : callable, optional
    """
    grid = VoxelGrid(**store.attributes["grid"])
    expected = {"time": times, "frame": frames, **dict(zip("xyz", grid.axes(), strict=True))}
    for name, values in expected.items():
        try:
            if np.array_equal(store.values(name), values):
                continue
            line = f"{store.path}: {name}: found other values than this run's; written again"
        except ValueError as error:
            line = str(error)
        logger.warning("%s", line)
        store.write_coordinates(name, values)
    damaged = []
    for block in blocks_of(store.n_frames):
        if progress:
            progress(block.start, store.n_frames, "reading what is there")
        if store.damage(block):
            damaged.append(block)
    if progress:
        progress(store.n_frames, store.n_frames, "")
    if not damaged:  # nothing is written: the store may be on a disk that allows none
        return
    with Claims(store.path) as claims:
        for block in damaged:
            if not claims.take(block, wait=False):
                continue
            found = store.damage(block)  # another run may have done it again since
            if found:
                store.forget(block, found)
            for line in dict.fromkeys(found.values()):
                logger.warning("%s", line)
            claims.release(block)
