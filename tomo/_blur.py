"""A Gaussian blur of the live voxels, axis by axis, in lines no longer than what is live needs.

The same as `scipy.ndimage.gaussian_filter` with zeros around and the dead voxels held at zero, on
all cores and in the time that the live voxels take.
"""

from __future__ import annotations

import math
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from tomo._compile import compiled
from tomo._threads import threads_worth
from tomo.live_voxels import LiveVoxels

TRUNCATE = 3.0
"""Standard deviations at which the kernel is cut."""

NANOSECONDS_A_TAP = 0.3  # and voxel, on one thread

_Lines = tuple[NDArray[np.integer], ...]
"""Lines along z: where each begins in what holds all of them (lines + 1,), at which height along z
it begins (lines,), its place (lines, 2), and the number of the line at each place, -1 where there
is none (nx, ny)."""


@compiled(inline=True)
def _add(onto, begin, end, height, weight, added, first, last, at) -> None:
    """Add ``weight`` times ``added[first:last]`` to ``onto[begin:end]`` where there is both.

    ``height`` and ``at`` are where along z the two begin.
    """
    low = max(height, at)
    count = min(height + end - begin, at + last - first) - low
    if count > 0:
        here, there = np.uint64(begin + low - height), np.uint64(first + low - at)
        for z in range(np.uint64(count)):
            onto[here + z] += weight * added[there + z]


@compiled(parallel=True)
def _blurred(values, voxels, heights, taps, own, along, across, room, out):
    """Add to ``out`` (n,), zeros, the blur of ``values`` (n,) along z, y and x in turn.

    Parameters
    ----------
    voxels : (lines + 1,) int64
        Where the voxels of each line with live ones begin.
    heights : (n,) int
        Of every voxel along z.
    taps : (2 * reach + 1,)
    own, along, across : _Lines
        The lines with live voxels from the lowest of them to the highest; the same as far as a
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
            plain[first:last] = 0
            for voxel in range(one, beyond):
                plain[np.uint64(first + heights[voxel] - low)] = values[voxel]
        begin, end, height = along[0][number], along[0][number + 1], along[1][number]
        blurred[begin:end] = 0
        for tap in range(len(taps)):
            at = low + reach - tap
            if gaps:
                _add(blurred, begin, end, height, taps[tap], plain, first, last, at)
            else:
                _add(blurred, begin, end, height, taps[tap], values, one, beyond, at)
    for number in numba.prange(len(across[1])):
        begin, end, height = across[0][number], across[0][number + 1], across[1][number]
        spread[begin:end] = 0
        x, y = across[2][number, 0], across[2][number, 1]
        for other in range(max(0, y - reach), min(along[3].shape[1], y + reach + 1)):
            from_line = along[3][x, other]
            if from_line >= 0:
                _add(
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
                    _add(plain, begin, end, height, weight, spread, first, last, at)
                else:
                    _add(out, one, beyond, height, weight, spread, first, last, at)
        if gaps:
            for voxel in range(one, beyond):
                out[voxel] = plain[np.uint64(begin + heights[voxel] - height)]


def _lines(low: NDArray[np.integer], high: NDArray[np.integer]) -> _Lines:
    """Return the lines from ``low`` to ``high`` (nx, ny), where ``high`` is above ``low``."""
    numbers = np.full(low.shape, -1, np.int64)
    places = np.argwhere(high > low)
    x, y = places.T
    numbers[x, y] = np.arange(len(places))
    begin = np.append(0, np.cumsum(high[x, y] - low[x, y]))
    return begin, low[x, y], places, numbers


class Blur:
    """A Gaussian blur from live voxels to live voxels; its matrix is symmetric.

    Parameters
    ----------
    live : LiveVoxels
    width : float
        Standard deviation in voxels.
    """

    def __init__(self, live: LiveVoxels, width: float) -> None:
        self.live = live
        reach = int(TRUNCATE * width + 0.5)
        taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
        self._taps = taps / math.fsum(taps)
        self._reach = reach

    @cached_property
    def _courses(self) -> tuple:
        """The voxels of the lines, their heights, and the three kinds of lines; see the kernel."""
        mask, depth = self.live.mask, self.live.grid.shape[2]
        inside = mask.any(axis=2)  # (nx, ny)
        low = np.where(inside, mask.argmax(axis=2), depth)
        high = np.where(inside, depth - mask[:, :, ::-1].argmax(axis=2), 0)
        voxels = np.append(0, np.cumsum(np.count_nonzero(mask, axis=2)[inside]))
        heights = np.nonzero(mask)[2].astype(np.int32)
        own = _lines(low, high)
        along = _lines(
            np.where(inside, np.maximum(low - self._reach, 0), depth),
            np.where(inside, np.minimum(high + self._reach, depth), 0),
        )
        near = 2 * self._reach + 1
        across = _lines(
            minimum_filter1d(low, near, axis=0, mode="constant", cval=depth),
            maximum_filter1d(high, near, axis=0, mode="constant", cval=0),
        )
        return voxels, heights, own, along, across

    def __call__(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the blurred live voxels: ``(n,)``, in the type of ``values``."""
        voxels, heights, *lines = self._courses
        values = np.ascontiguousarray(values)
        room = tuple(np.zeros(int(one[0][-1]), values.dtype) for one in lines)
        out = np.zeros_like(values)
        taps = self._taps.astype(values.dtype)
        with threads_worth(NANOSECONDS_A_TAP * len(taps) * values.size):
            _blurred(values, voxels, heights, taps, *lines, room, out)
        return out
