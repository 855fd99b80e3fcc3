"""A Gaussian blur of the live voxels, axis by axis, that passes over lines without any.

The same as `scipy.ndimage.gaussian_filter` with zeros around and the dead voxels held at zero, on
all cores and in the time that the live voxels take.
"""

from __future__ import annotations

import math
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compile import compiled
from tomo.live_voxels import LiveVoxels

TRUNCATE = 3.0
"""Standard deviations at which the kernel is cut."""


@compiled(inline=True)
def _add(line, weight, other) -> None:
    """Add ``weight`` times another line."""
    for z in range(len(line)):
        line[z] += weight * other[z]


@compiled(parallel=True)
def _along(volume, taps, lines, out) -> None:
    """Write to ``out`` the lines along z of ``volume`` (nx, ny, nz), blurred along themselves."""
    reach, depth = len(taps) // 2, volume.shape[2]
    for number in numba.prange(len(lines)):
        line = out[lines[number, 0], lines[number, 1]]
        source = volume[lines[number, 0], lines[number, 1]]
        line[:] = 0
        for tap in range(len(taps)):
            low, high = max(0, reach - tap), min(depth, depth + reach - tap)
            if low < high:
                shifted = source[low + tap - reach : high + tap - reach]
                _add(line[low:high], taps[tap], shifted)


@compiled(parallel=True)
def _across(volume, taps, lines, filled, axis, out) -> None:
    """Write to ``out`` lines along z, blurred along x (axis 0) or y (1); others hold nothing.

    ``filled`` (nx, ny) tells the lines of ``volume`` that have been written.
    """
    reach = len(taps) // 2
    for number in numba.prange(len(lines)):
        x, y = lines[number]
        line = out[x, y]
        line[:] = 0
        at = x if axis == 0 else y
        for other in range(max(0, at - reach), min(volume.shape[axis], at + reach + 1)):
            from_x, from_y = (other, y) if axis == 0 else (x, other)
            if filled[from_x, from_y]:
                _add(line, taps[other - at + reach], volume[from_x, from_y])


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
    def _lines(self) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Lines along z with live voxels, and those within reach along x: numbers and masks.

        Of the box around the live voxels, as all volumes here.
        """
        own = self.live.box.mask.any(axis=2)  # (bx, by)
        below = np.cumsum(np.pad(own, ((self._reach + 1, self._reach), (0, 0))), axis=0)
        near = below[2 * self._reach + 1 :] > below[: len(own)]
        return np.argwhere(own), own, np.argwhere(near), near

    def __call__(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the blurred live voxels: ``(n,)``, in the type of ``values``."""
        box = self.live.box
        volume = box.expand(values).reshape(box.grid.shape)
        taps = self._taps.astype(volume.dtype)
        own_lines, own, near_lines, near = self._lines
        first, second = np.zeros_like(volume), np.zeros_like(volume)
        _along(volume, taps, own_lines, first)
        _across(first, taps, near_lines, own, 1, second)
        _across(second, taps, own_lines, near, 0, first)
        return box.compress(first)
