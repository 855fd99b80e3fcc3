"""The active voxels as a dense box, in arrays of any library: gathers and shifted sums alone.

On the CPU compiled loops over runs of voxels do the same (`tomo.grid.z_runs`). Elementwise sums in
the order written here have the same bits in every run and on every device.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tomo._compute.arrays import like, namespace, zeros
from tomo._compute.grouping import index_type


class DenseBox:
    """The smallest box around active voxels (`ActiveVoxels.box`), which holds zero where none is.

    The numbers by which voxels are gathered stay where they were used last: with 4 bytes a voxel
    of the box and 4 an active one, none where the grid is active altogether.
    """

    def __init__(self, box: Any) -> None:
        self._box, self.shape = box, box.grid.shape
        self._held: tuple[Any, ...] = (None,)

    def expand(self, values: Any) -> Any:
        """Return the box ``(bx, by, bz, ...)`` of the active voxels' values ``(n, ...)``."""
        xp, more = namespace(values), values.shape[1:]
        if not self._box.all:
            padded = xp.concat([values, zeros((1, *more), values)])
            values = xp.take(padded, self._numbers(values)[0], axis=0)
        return xp.reshape(values, (*self.shape, *more))

    def compress(self, dense: Any) -> Any:
        """Return the values ``(n, ...)`` of the active voxels of a box."""
        xp = namespace(dense)
        values = xp.reshape(dense, (-1, *dense.shape[3:]))
        return values if self._box.all else xp.take(values, self._numbers(dense)[1], axis=0)

    def _numbers(self, values: Any) -> tuple[Any, Any]:
        """Return the unknown of each voxel, ``n`` for none, and the voxel of each unknown."""
        place = type(values), values.device
        if self._held[0] != place:
            kind = index_type(self._box.grid.size)
            number = np.where(self._box.number < 0, self._box.size, self._box.number).astype(kind)
            index = self._box.index.astype(kind)
            self._held = place, like(number, values), like(index, values)
        return self._held[1:]


def blurred(dense: Any, taps: Sequence[float]) -> Any:
    """Return a box blurred along its three axes by some taps; zero is around it.

    Axes and taps follow in the order of `tomo.grid.blur`, which gives the same bits.
    """
    reach = len(taps) // 2
    for axis in (2, 1, 0):
        count = dense.shape[axis]
        padded = pad(dense, axis, reach, reach)
        dense = taps[0] * part(padded, axis, 0, count)
        for first in range(1, len(taps)):
            dense = dense + taps[first] * part(padded, axis, first, first + count)
    return dense


def part(dense: Any, axis: int, first: int, last: int) -> Any:
    """Return the layers ``first:last`` along an axis."""
    return dense[(*[slice(None)] * axis, slice(first, last), ...)]


def pad(dense: Any, axis: int, before: int, after: int) -> Any:
    """Return an array with so many layers of zeros before and after it along an axis."""
    shapes = ((*dense.shape[:axis], n, *dense.shape[axis + 1 :]) for n in (before, after))
    low, high = (zeros(shape, dense) for shape in shapes)
    return namespace(dense).concat([low, dense, high], axis=axis)
