"""The time that a reconstruction takes on this machine, from a sample of its rays."""

from __future__ import annotations

import time
import timeit
from dataclasses import dataclass

import numpy as np

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.operators.memory import MemoryNeed, choose_form, estimate_memory
from tomo.operators.system import LinearSystem, VolumeNotSeenError

_SEGMENTS = 4_000_000  # in the larger sample: more take over a second, fewer time the overhead


@dataclass(frozen=True)
class Effort:
    """The memory and time of a reconstruction from all pixels, dark ones included."""

    need: MemoryNeed
    form: str  # of the projector: ``stored`` or ``on-the-fly``
    trace_seconds: float  # to set up the projector, once for a rig and a grid
    iteration_seconds: float  # of one product with the projector and one with its transpose


def estimate_effort(rig: Rig, grid: VoxelGrid, *, available: int | None = None) -> Effort:
    """Time two random samples of the rays and extrapolate along the line through both.

    ``available`` are the bytes that may be used; what the system has free when None.

    Raises
    ------
    ValueError
        If the grid does not fit in memory, or no camera sees it.
    """
    form, _ = choose_form(tuple(rig), grid, available=available)
    need = estimate_memory(tuple(rig), grid, form=form)
    fraction = min(1.0, _SEGMENTS / max(need.segments, 1))
    _timed(rig, grid, form, 0.01 * fraction)  # compiles and fills caches
    few = _timed(rig, grid, form, 0.2 * fraction)
    many = _timed(rig, grid, form, fraction)
    trace, iteration = (
        _at(need.segments, few[0], many[0], few[number], many[number]) for number in (1, 2)
    )
    return Effort(need, form, trace, iteration)


def _timed(rig: Rig, grid: VoxelGrid, form: str, fraction: float) -> tuple[int, float, float]:
    """Return the segments of a sample, and the seconds to set it up and of two products."""
    start = time.perf_counter()
    projector = _sampled(rig, grid, form, fraction).projector
    traced = time.perf_counter() - start
    volume = np.ones(projector.shape[1], np.float32)
    taken = timeit.repeat(lambda: projector.T @ (projector @ volume), number=1)
    return projector.n_segments, traced, min(taken)  # the fastest counts


def _at(segments: int, few: int, many: int, short: float, long: float) -> float:
    """Return the time of all segments on the line through two samples: voxels take time too."""
    slope = max(long - short, 0.0) / max(many - few, 1)
    return max(long + slope * (segments - many), long)


def _sampled(rig: Rig, grid: VoxelGrid, form: str, fraction: float) -> LinearSystem:
    """Return the equations of a random fraction of the pixels, of more if none sees the grid."""
    rng = np.random.default_rng(0)
    masks = []
    for camera in rig:
        width, height = camera.image_size
        mask = rng.random((height, width)) < fraction
        mask[height // 2, width // 2] = True  # at least one
        masks.append(mask)
    try:
        return LinearSystem.from_rig(rig, grid, masks=masks, form=form)
    except VolumeNotSeenError:
        if fraction >= 1:
            raise
    return _sampled(rig, grid, form, min(10 * fraction, 1.0))
