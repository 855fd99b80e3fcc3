"""How long a reconstruction takes on this machine, from a sample of its rays."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.operators.memory import MemoryNeed, choose_form, estimate_memory
from tomo.operators.system import LinearSystem, VolumeNotSeenError

_CROSSINGS = 4_000_000  # of the larger sample: a second
_PRODUCTS = 3


@dataclass(frozen=True)
class Effort:
    """What a reconstruction from all pixels takes, before anything dark is left out.

    Attributes
    ----------
    need : MemoryNeed
        Rays, crossings and bytes.
    form : str
        Of the projector: ``stored`` or ``on-the-fly``.
    trace_seconds : float
        Setting up the projector, once for a rig and a grid.
    iteration_seconds : float
        One product with the projector and one with its transpose.
    """

    need: MemoryNeed
    form: str
    trace_seconds: float
    iteration_seconds: float


def estimate_effort(rig: Rig, grid: VoxelGrid, *, available: int | None = None) -> Effort:
    """Time two random samples of the rays and go on along the line through both.

    Parameters
    ----------
    rig : Rig
    grid : VoxelGrid
    available : int, optional
        Bytes that may be used; what the system has free when None.

    Raises
    ------
    ValueError
        If the grid does not fit in memory, or no camera sees it.
    """
    form, _ = choose_form(tuple(rig), grid, available=available)
    need = estimate_memory(tuple(rig), grid, form=form)
    share = min(1.0, _CROSSINGS / max(need.segments, 1))
    _timed(rig, grid, form, 0.01 * share)  # compiles, and warms caches
    few = _timed(rig, grid, form, 0.2 * share)
    many = _timed(rig, grid, form, share)
    trace, iteration = (
        _at(need.segments, few[0], many[0], few[number], many[number]) for number in (1, 2)
    )
    return Effort(need, form, trace, iteration)


def _timed(rig: Rig, grid: VoxelGrid, form: str, share: float) -> tuple[int, float, float]:
    """Return a sample's crossings, the seconds to set it up and those of two products."""
    start = time.perf_counter()
    projector = _sampled(rig, grid, form, share).projector
    traced = time.perf_counter() - start
    volume = np.ones(projector.shape[1], np.float32)
    taken = []
    for _ in range(_PRODUCTS):
        start = time.perf_counter()
        projector.T @ (projector @ volume)
        taken.append(time.perf_counter() - start)
    return projector.n_segments, traced, min(taken)


def _at(crossings: int, few: int, many: int, short: float, long: float) -> float:
    """Return the time of all crossings on the line through two samples: voxels cost some too."""
    slope = max(long - short, 0.0) / max(many - few, 1)
    return max(long + slope * (crossings - many), long)


def _sampled(rig: Rig, grid: VoxelGrid, form: str, share: float) -> LinearSystem:
    """Return the equations of a random share of the pixels; of more where none sees the grid."""
    rng = np.random.default_rng(0)
    masks = []
    for camera in rig:
        width, height = camera.image_size
        mask = rng.random((height, width)) < share
        mask[height // 2, width // 2] = True  # at least one
        masks.append(mask)
    try:
        return LinearSystem.from_rig(rig, grid, masks=masks, form=form)
    except VolumeNotSeenError:
        if share >= 1:
            raise
    return _sampled(rig, grid, form, min(10 * share, 1.0))
