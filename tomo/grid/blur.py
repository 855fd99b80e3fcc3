"""A Gaussian blur of the active voxels, axis by axis, in z-runs as long as these need.

The same as `scipy.ndimage.gaussian_filter` with zeros around and inactive voxels held at zero, on
all cores and in the time that the active voxels take.
"""

from __future__ import annotations

import math
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from tomo._compute.arrays import is_numpy
from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.grid.active_voxels import ActiveVoxels
from tomo.grid.dense import blurred
from tomo.grid.z_runs import add, lay_out, pick_up, runs_between

TRUNCATE = 3.0
"""Standard deviations at which a blur is cut: fewer leave an edge, more take time for 0.3 %."""

NANOSECONDS_A_TAP = 0.3  # a tap and voxel, on one thread


@compiled(parallel=True)
def _blurred(values, voxels, heights, taps, own, along, across, room, out):
    """Add to ``out`` (n,), zeros, the blur of ``values`` (n,) along z, y and x in turn.

    ``voxels`` (runs + 1,) and ``heights`` (n,) as of `ZRuns`, ``taps`` (2 * reach + 1,).
    ``own, along, across`` are `tomo.grid.z_runs.Runs`: those with active voxels from the lowest to
    the highest; as far as a blur along z reaches; those near enough along x, as long as neighbours
    need. ``room`` are three buffers of these runs; a run without a gap is not copied: its voxels
    are it.
    """
    reach = len(taps) // 2
    plain, blurred, widened = room
    for number in numba.prange(len(own[1])):
        first, last, low = own[0][number], own[0][number + 1], own[1][number]
        one, beyond = voxels[number], voxels[number + 1]
        gaps = last - first > beyond - one
        if gaps:
            lay_out(values, voxels, heights, own, number, plain)
        begin, end, height = along[0][number], along[0][number + 1], along[1][number]
        blurred[begin:end] = 0
        for tap in range(len(taps)):
            at = low + reach - tap
            if gaps:
                add(blurred, begin, end, height, taps[tap], plain, first, last, at)
            else:
                add(blurred, begin, end, height, taps[tap], values, one, beyond, at)
    for number in numba.prange(len(across[1])):
        begin, end, height = across[0][number], across[0][number + 1], across[1][number]
        widened[begin:end] = 0
        x, y = across[2][number, 0], across[2][number, 1]
        for other in range(max(0, y - reach), min(along[3].shape[1], y + reach + 1)):
            other_run = along[3][x, other]
            if other_run >= 0:
                add(
                    widened, begin, end, height, taps[other - y + reach],
                    blurred, along[0][other_run], along[0][other_run + 1], along[1][other_run],
                )  # fmt: skip
    for number in numba.prange(len(own[1])):
        begin, end, height = own[0][number], own[0][number + 1], own[1][number]
        one, beyond = voxels[number], voxels[number + 1]
        gaps = end - begin > beyond - one
        if gaps:
            plain[begin:end] = 0
        x, y = own[2][number, 0], own[2][number, 1]
        for other in range(max(0, x - reach), min(across[3].shape[0], x + reach + 1)):
            other_run = across[3][other, y]
            if other_run >= 0:
                weight, at = taps[other - x + reach], across[1][other_run]
                first, last = across[0][other_run], across[0][other_run + 1]
                if gaps:
                    add(plain, begin, end, height, weight, widened, first, last, at)
                else:
                    add(out, one, beyond, height, weight, widened, first, last, at)
        if gaps:
            pick_up(plain, voxels, heights, own, number, out)


class Blur:
    """A Gaussian blur from active voxels to active voxels; its matrix is symmetric.

    Parameters
    ----------
    active : ActiveVoxels
    width : float
        Standard deviation in voxels.
    """

    def __init__(self, active: ActiveVoxels, width: float) -> None:
        self.active = active
        reach = int(TRUNCATE * width + 0.5)
        taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
        self._taps = taps / math.fsum(taps)
        self._reach = reach

    @cached_property
    def _runs(self) -> tuple:
        """The voxels of the runs, their heights, and the three kinds of runs; see the kernel."""
        runs = self.active.z_runs
        low, high, depth = runs.low, runs.high, runs.depth
        along = runs_between(
            np.where(runs.inside, np.maximum(low - self._reach, 0), depth),
            np.where(runs.inside, np.minimum(high + self._reach, depth), 0),
        )
        near = 2 * self._reach + 1
        across = runs_between(
            minimum_filter1d(low, near, axis=0, mode="constant", cval=depth),
            maximum_filter1d(high, near, axis=0, mode="constant", cval=0),
        )
        return runs.voxels, runs.heights, runs.own, along, across

    def __call__(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the blurred active voxels: ``(n,)``, in the type of ``values``.

        Arrays of other libraries may have columns, ``(n, columns)``.
        """
        if not is_numpy(values):
            dense = self.active.dense
            return dense.compress(blurred(dense.expand(values), self._taps.tolist()))
        voxels, heights, *runs = self._runs
        values = np.ascontiguousarray(values)
        room = tuple(np.zeros(int(one[0][-1]), values.dtype) for one in runs)
        out = np.zeros_like(values)
        taps = self._taps.astype(values.dtype)
        with threads_worth(NANOSECONDS_A_TAP * len(taps) * values.size):
            _blurred(values, voxels, heights, taps, *runs, room, out)
        return out
