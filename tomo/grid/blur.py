"""A Gaussian blur of the active voxels, axis by axis, in lines as long as these need.

The same as `scipy.ndimage.gaussian_filter` with zeros around and the dead voxels held at zero, on
all cores and in the time that the active voxels take.
"""

from __future__ import annotations

import math
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.grid.active_voxels import ActiveVoxels
from tomo.grid.z_runs import add, lay_out, lines_between, pick_up

TRUNCATE = 3.0
"""Standard deviations at which the kernel is cut."""

NANOSECONDS_A_TAP = 0.3  # and voxel, on one thread


@compiled(parallel=True)
def _blurred(values, voxels, heights, taps, own, along, across, room, out):
    """Add to ``out`` (n,), zeros, the blur of ``values`` (n,) along z, y and x in turn.

    Parameters
    ----------
    voxels : (lines + 1,) int64
        Where the voxels of each line with active ones begin.
    heights : (n,) int
        Of every voxel along z.
    taps : (2 * reach + 1,)
    own, along, across : tomo.grid.z_runs.Lines
        The lines with active voxels from the lowest of them to the highest; the same as far as a
        blur along z reaches; those near enough along x, as long as their neighbours need.
    room : three vectors
        That hold these lines. One without a gap is not copied into it: its voxels are the line.
    """
    reach = len(taps) // 2
    plain, blurred, spread = room
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
        spread[begin:end] = 0
        x, y = across[2][number, 0], across[2][number, 1]
        for other in range(max(0, y - reach), min(along[3].shape[1], y + reach + 1)):
            from_line = along[3][x, other]
            if from_line >= 0:
                add(
                    spread, begin, end, height, taps[other - y + reach],
                    blurred, along[0][from_line], along[0][from_line + 1], along[1][from_line],
                )  # fmt: skip
    for number in numba.prange(len(own[1])):
        begin, end, height = own[0][number], own[0][number + 1], own[1][number]
        one, beyond = voxels[number], voxels[number + 1]
        gaps = end - begin > beyond - one
        if gaps:
            plain[begin:end] = 0
        x, y = own[2][number, 0], own[2][number, 1]
        for other in range(max(0, x - reach), min(across[3].shape[0], x + reach + 1)):
            from_line = across[3][other, y]
            if from_line >= 0:
                weight, at = taps[other - x + reach], across[1][from_line]
                first, last = across[0][from_line], across[0][from_line + 1]
                if gaps:
                    add(plain, begin, end, height, weight, spread, first, last, at)
                else:
                    add(out, one, beyond, height, weight, spread, first, last, at)
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
    def _courses(self) -> tuple:
        """The voxels of the lines, their heights, and the three kinds of lines; see the kernel."""
        lines = self.active.lines
        low, high, depth = lines.low, lines.high, lines.depth
        along = lines_between(
            np.where(lines.inside, np.maximum(low - self._reach, 0), depth),
            np.where(lines.inside, np.minimum(high + self._reach, depth), 0),
        )
        near = 2 * self._reach + 1
        across = lines_between(
            minimum_filter1d(low, near, axis=0, mode="constant", cval=depth),
            maximum_filter1d(high, near, axis=0, mode="constant", cval=0),
        )
        return lines.voxels, lines.heights, lines.own, along, across

    def __call__(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the blurred active voxels: ``(n,)``, in the type of ``values``."""
        voxels, heights, *lines = self._courses
        values = np.ascontiguousarray(values)
        room = tuple(np.zeros(int(one[0][-1]), values.dtype) for one in lines)
        out = np.zeros_like(values)
        taps = self._taps.astype(values.dtype)
        with threads_worth(NANOSECONDS_A_TAP * len(taps) * values.size):
            _blurred(values, voxels, heights, taps, *lines, room, out)
        return out
