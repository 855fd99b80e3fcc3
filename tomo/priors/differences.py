"""Linear priors: differences of neighbouring voxels, and the unknowns themselves."""

from __future__ import annotations

from functools import cached_property

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import is_numpy, namespace
from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.grid import ActiveVoxels
from tomo.grid.z_runs import Runs, ZRuns, add, lay_out, pick_up, runs_between
from tomo.priors.dense import differences, transposed_differences

NANOSECONDS_FORWARD, NANOSECONDS_ADJOINT = 1.2, 1.6  # a voxel of the runs, on one thread
OUTSIDE = -2  # number of a run beyond the grid, where -1 is none inside it


@compiled(inline=True)
def _add_run(onto, begin, end, height, weight, added, runs, run, lower) -> None:
    """Add the run ``added`` to part of another one, if there is one, moved down by ``lower``."""
    if run >= 0:
        first, last = runs[0][run], runs[0][run + 1]
        add(onto, begin, end, height, weight, added, first, last, runs[1][run] - lower)


@compiled(parallel=True)
def _forward(values, voxels, heights, own, around, here, beyond, top, step, factors, plain, field):
    """Write the differences of ``values`` (n,) to ``field`` (3, positions), which holds zeros.

    ``plain`` is a buffer of the runs ``own``; ``top`` is the height of the grid's topmost layer,
    ``step`` that of one layer; the other arguments are those of `Gradient`.
    """
    plus, minus = np.float32(1), np.float32(-1)
    for run in numba.prange(len(own[1])):
        lay_out(values, voxels, heights, own, run, plain)
    for run in numba.prange(len(around[1])):
        begin, end, height = around[0][run], around[0][run + 1], around[1][run]
        for axis in range(3):
            onto, last, other = field[axis], end, here[run]
            if axis < 2:
                other = beyond[run, axis]
                if other == OUTSIDE:
                    continue
            else:  # the grid's topmost layer has none above
                last = min(end, begin + top - height)
            lower = step if axis == 2 else 0
            _add_run(onto, begin, last, height, plus, plain, own, other, lower)
            _add_run(onto, begin, last, height, minus, plain, own, here[run], 0)
            for position in range(np.uint64(begin), np.uint64(last)):
                onto[position] *= factors[axis]


@compiled(parallel=True)
def _adjoint(
    field, voxels, heights, own, around, at, before, beyond, top, step, factors, plain, out
):
    """Write ``D^T`` of ``field`` (3, positions) to ``out`` (n,)."""
    for run in numba.prange(len(own[1])):
        begin, end, height = own[0][run], own[0][run + 1], own[1][run]
        plain[begin:end] = 0
        for axis in range(2):
            added, weight = field[axis], factors[axis]
            if beyond[at[run], axis] != OUTSIDE:
                _add_run(plain, begin, end, height, -weight, added, around, at[run], 0)
            _add_run(plain, begin, end, height, weight, added, around, before[run, axis], 0)
        below_top = min(end, begin + top - height)
        _add_run(plain, begin, below_top, height, -factors[2], field[2], around, at[run], 0)
        _add_run(plain, begin, end, height, factors[2], field[2], around, at[run], -step)
        pick_up(plain, voxels, heights, own, run, out)


class Gradient:
    """The forward differences ``D`` of a volume that is zero where no voxel is active.

    Component ``a`` at a voxel is ``(x[v + e_a] - x[v]) h / h_a``, with ``h`` the geometric mean of
    the spacings: for cubes the plain difference of neighbours. Across the outer faces of the grid
    there is no difference, since nothing is known of what lies beyond; a voxel inside the grid
    that is not active is known to be zero, and differences to it count.

    Parameters
    ----------
    columns : int
        Volumes at once, whose values at a voxel lie side by side: ``(n, columns)``.

    Notes
    -----
    Fields cover the z-runs around the active voxels, far enough for every difference that can be
    other than zero, instead of the whole grid. `tomo.grid.z_runs.Runs` are ``own``, those of the
    active voxels, and ``around``, those of a field. ``here`` and ``beyond`` (runs, 2) number the
    former in the column of each of the latter and in its upper neighbours along x and y, `OUTSIDE`
    beyond the grid; ``at`` and ``before`` (runs, 2) number the latter in the column of each of the
    former and in its lower neighbours.

    `forward` and `adjoint` pass the dot test to 1e-6, in single precision.
    """

    def __init__(self, active: ActiveVoxels, columns: int = 1) -> None:
        self.active, self.columns = active, columns
        spacing = np.asarray(active.grid.spacing, np.float64)
        self.factors = (np.prod(spacing) ** (1 / 3) / spacing).astype(np.float32)  # (3,)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of a field: three components at every position of the runs ``around``."""
        return 3, int(self._around[0][-1])

    @cached_property
    def _runs(self) -> ZRuns:
        return self.active.z_runs.side_by_side(self.columns)

    @cached_property
    def _around(self) -> Runs:
        runs = self._runs
        low = np.where(runs.inside, np.maximum(runs.low - self.columns, 0), runs.depth)
        high = runs.high.copy()
        for near_low, near_high in ((low[:-1], high[:-1]), (low[:, :-1], high[:, :-1])):
            x, y = (runs.low.shape[axis] - near_low.shape[axis] for axis in (0, 1))
            np.minimum(near_low, runs.low[x:, y:], out=near_low)
            np.maximum(near_high, runs.high[x:, y:], out=near_high)
        return runs_between(low, high)

    @cached_property
    def _neighbours(self) -> tuple[NDArray[np.int64], ...]:
        """Return ``here``, ``beyond``, ``at`` and ``before``."""
        own, around = self._runs.own, self._around

        def numbers(table: NDArray[np.integer], columns: NDArray, step: ArrayLike) -> NDArray:
            padded = np.pad(table, 1, constant_values=OUTSIDE)
            return padded[tuple((columns + np.asarray(step)).T + 1)]

        steps = np.eye(2, dtype=np.int64)
        return (
            numbers(own[3], around[2], (0, 0)),
            np.stack([numbers(own[3], around[2], step) for step in steps], axis=1),
            numbers(around[3], own[2], (0, 0)),
            np.stack([numbers(around[3], own[2], -step) for step in steps], axis=1),
        )

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D x`` of the unknowns ``x (n,)`` or ``(n, columns)``: ``(3, positions)``.

        Of another library's array ``(3, bx, by, bz, ...)``, in the box of the active voxels.
        """
        if not is_numpy(values):
            return differences(self.active.dense.expand(values), self.factors.tolist())
        runs, around = self._runs, self._around
        here, beyond, _, _ = self._neighbours
        field = np.zeros(self.shape, np.float32)
        plain = np.zeros(int(runs.own[0][-1]), np.float32)
        values = np.ascontiguousarray(values.ravel(), np.float32)
        with threads_worth(NANOSECONDS_FORWARD * field.shape[1]):
            _forward(
                values, runs.voxels, runs.heights, runs.own, around, here, beyond,
                runs.depth - self.columns, self.columns, self.factors, plain, field,
            )  # fmt: skip
        return field

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D^T p (n,)`` or ``(n, columns)`` of a field as `forward` returns it."""
        if not is_numpy(field):
            dense, columns = self.active.dense, (self.columns,) * (self.columns > 1)
            field = namespace(field).reshape(field, (3, *dense.shape, *columns))
            return dense.compress(transposed_differences(field, self.factors.tolist()))
        runs, around = self._runs, self._around
        _, beyond, at, before = self._neighbours
        plain = np.zeros(int(runs.own[0][-1]), np.float32)
        out = np.zeros(self.active.size * self.columns, np.float32)
        with threads_worth(NANOSECONDS_ADJOINT * field.size / 3):
            _adjoint(
                np.ascontiguousarray(field.reshape(self.shape), np.float32), runs.voxels,
                runs.heights, runs.own, around, at, before, beyond,
                runs.depth - self.columns, self.columns, self.factors, plain, out,
            )  # fmt: skip
        return out if self.columns == 1 else out.reshape(-1, self.columns)


class Magnitude:
    """The identity: ``||x||²`` counts the squares of the unknowns themselves."""

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``x``."""
        return values

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``p``."""
        return field
