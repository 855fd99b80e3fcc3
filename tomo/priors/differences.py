"""Differences of neighbouring voxels, and their exact transpose."""

from __future__ import annotations

from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.grid import ActiveVoxels
from tomo.grid.z_runs import Lines, add, lay_out, lines_between, pick_up

NANOSECONDS_FORWARD, NANOSECONDS_ADJOINT = 1.2, 1.6  # a place, on one thread
OUTSIDE = -2


@compiled(inline=True)
def _add_line(onto, begin, end, height, weight, added, lines, line, lower) -> None:
    """Add to part of a line what ``added`` holds of another, if there is one, moved down."""
    if line >= 0:
        first, last = lines[0][line], lines[0][line + 1]
        add(onto, begin, end, height, weight, added, first, last, lines[1][line] - lower)


@compiled(parallel=True)
def _forward(values, voxels, heights, own, around, here, beyond, depth, factors, plain, field):
    """Write the differences of ``values`` (n,) to ``field`` (3, places), which holds zeros.

    ``plain`` has room for the lines ``own``; the others are those of `Gradient`.
    """
    plus, minus = np.float32(1), np.float32(-1)
    for line in numba.prange(len(own[1])):
        lay_out(values, voxels, heights, own, line, plain)
    for line in numba.prange(len(around[1])):
        begin, end, height = around[0][line], around[0][line + 1], around[1][line]
        for axis in range(3):
            onto, last, other = field[axis], end, here[line]
            if axis < 2:
                other = beyond[line, axis]
                if other == OUTSIDE:
                    continue
            else:  # the grid's topmost layer has none above
                last = min(end, begin + depth - 1 - height)
            _add_line(onto, begin, last, height, plus, plain, own, other, axis // 2)
            _add_line(onto, begin, last, height, minus, plain, own, here[line], 0)
            for place in range(np.uint64(begin), np.uint64(last)):
                onto[place] *= factors[axis]


@compiled(parallel=True)
def _adjoint(field, voxels, heights, own, around, at, before, beyond, depth, factors, plain, out):
    """Write to ``out`` (n,) what the transpose makes of ``field`` (3, places)."""
    for line in numba.prange(len(own[1])):
        begin, end, height = own[0][line], own[0][line + 1], own[1][line]
        plain[begin:end] = 0
        for axis in range(2):
            added, weight = field[axis], factors[axis]
            if beyond[at[line], axis] != OUTSIDE:
                _add_line(plain, begin, end, height, -weight, added, around, at[line], 0)
            _add_line(plain, begin, end, height, weight, added, around, before[line, axis], 0)
        below_top = min(end, begin + depth - 1 - height)
        _add_line(plain, begin, below_top, height, -factors[2], field[2], around, at[line], 0)
        _add_line(plain, begin, end, height, factors[2], field[2], around, at[line], -1)
        pick_up(plain, voxels, heights, own, line, out)


class Gradient:
    """The forward differences ``D`` of a volume that is zero where no voxel is active.

    Component ``a`` at a voxel is ``(x[v + e_a] - x[v]) h / h_a``, with ``h`` the geometric mean of
    the spacings: for cubes the plain difference of neighbours. Across the outer faces of the grid
    there is no difference, since nothing is known of what lies beyond; a voxel inside the grid
    that is not active is known to be zero, and differences to it count.

    Parameters
    ----------
    active : ActiveVoxels

    Notes
    -----
    Fields cover the lines along z around the active voxels, far enough for every difference that
    can be other than zero, instead of the whole grid. Of `tomo.grid.z_runs.Lines` there are
    ``own``, those of the active voxels, and ``around``; ``here`` and ``beyond`` (lines, 2) number
    the former at each of the latter and at its upper neighbours along x and y, `OUTSIDE` beyond
    the grid; ``at`` and ``before`` (lines, 2) the latter at each of the former and at its lower
    neighbours.
    """

    def __init__(self, active: ActiveVoxels) -> None:
        self.active = active
        spacing = np.asarray(active.grid.spacing, np.float64)
        self.factors = (np.prod(spacing) ** (1 / 3) / spacing).astype(np.float32)  # (3,)

    @property
    def shape(self) -> tuple[int, int]:
        """Of a field: three components at every place of the lines ``around``."""
        return 3, int(self._around[0][-1])

    @cached_property
    def _around(self) -> Lines:
        lines = self.active.lines
        low = np.where(lines.inside, np.maximum(lines.low - 1, 0), lines.depth)
        high = lines.high.copy()
        for near_low, near_high in ((low[:-1], high[:-1]), (low[:, :-1], high[:, :-1])):
            x, y = (lines.low.shape[axis] - near_low.shape[axis] for axis in (0, 1))
            np.minimum(near_low, lines.low[x:, y:], out=near_low)
            np.maximum(near_high, lines.high[x:, y:], out=near_high)
        return lines_between(low, high)

    @cached_property
    def _neighbours(self) -> tuple[NDArray[np.int64], ...]:
        """Return ``here``, ``beyond``, ``at`` and ``before``."""
        own, around = self.active.lines.own, self._around

        def numbers(table: NDArray[np.int64], places: NDArray, step: tuple[int, int]) -> NDArray:
            padded = np.pad(table, 1, constant_values=OUTSIDE)
            return padded[tuple((places + step).T + 1)]

        steps = np.eye(2, dtype=np.int64)
        return (
            numbers(own[3], around[2], (0, 0)),
            np.stack([numbers(own[3], around[2], step) for step in steps], axis=1),
            numbers(around[3], own[2], (0, 0)),
            np.stack([numbers(around[3], own[2], -step) for step in steps], axis=1),
        )

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D x`` of the unknowns ``x (n,)``: ``(3, places)``."""
        lines, around = self.active.lines, self._around
        here, beyond, _, _ = self._neighbours
        field = np.zeros(self.shape, np.float32)
        plain = np.zeros(int(lines.own[0][-1]), np.float32)
        values = np.ascontiguousarray(values.ravel(), np.float32)
        with threads_worth(NANOSECONDS_FORWARD * field.shape[1]):
            _forward(
                values, lines.voxels, lines.heights, lines.own, around, here, beyond, lines.depth,
                self.factors, plain, field,
            )  # fmt: skip
        return field

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D^T p (n,)`` of a field with as many values as `forward` returns."""
        lines, around = self.active.lines, self._around
        _, beyond, at, before = self._neighbours
        plain = np.zeros(int(lines.own[0][-1]), np.float32)
        out = np.zeros(self.active.size, np.float32)
        with threads_worth(NANOSECONDS_ADJOINT * field.size / 3):
            _adjoint(
                np.ascontiguousarray(field.reshape(self.shape), np.float32), lines.voxels,
                lines.heights, lines.own, around, at, before, beyond, lines.depth, self.factors,
                plain, out,
            )  # fmt: skip
        return out
