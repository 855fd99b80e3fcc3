"""The part of a large volume in which errors are measured: a slab across its lines of sight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigs.check.coverage import coverage
from tomo.operators import LinearSystem
from tomo.operators.operator import ProjectionOperator
from tomo.uncertainty.residual_noise import Solve

SolveOf = Callable[[ProjectionOperator | None, NDArray[np.int64] | None], Solve]
"""The reconstruction of some unknowns from some pixels: called with their projection, as cut from
`cuttable`, and the pixels' numbers; with None for both, of everything."""

SEGMENTS = 1_000_000
"""Segments that the slab has about. With fewer, errors of few voxels stand for all; more take
their time."""

PLANES = 12
"""Planes of voxels that the slab has at least. A thinner one is known better than the volume: the
views resolve all of what is thin."""

FACES = 2
"""Planes beside a cut where errors do not count: the prior takes a cut for an edge."""


@dataclass(frozen=True, eq=False)
class Part:
    """Some of the unknowns, with the pixels that see them.

    ``system`` is on voxel means; ``rows`` (pixels,) says which of all pixels these are, all
    when None; ``inside`` (nx, ny, nz) are the voxels where errors count.
    """

    system: LinearSystem
    rows: NDArray[np.int64] | None
    solve: Solve
    inside: NDArray[np.bool_]

    def pixels(self, everything: NDArray) -> NDArray:
        """Return the part's of all pixels."""
        return everything if self.rows is None else everything[self.rows]


def whole(system: LinearSystem, solve: Solve) -> Part:
    """Return all of a system on voxel means."""
    return Part(system, None, solve, system.projector.active.mask)


def slab(
    system: LinearSystem,
    volume: NDArray[np.float32],
    solve_of: SolveOf,
    cuttable: ProjectionOperator,
) -> Part:
    """Return a slab around the middle of the emission; all where that is small or is not stored.

    It goes across the axis that the lines of sight are the least along: such rays stay in it, and
    what the views miss of it is what they miss of the volume. ``system`` is on voxel means,
    ``cuttable`` the projection in the basis that is solved in.
    """
    sight = coverage(system.rig, np.array([system.projector.grid.center])).directions[0]
    axis = int(np.argmin(np.square(sight).sum(axis=0)))
    count = volume.shape[axis]
    planes = max(round(count * SEGMENTS / max(cuttable.n_segments, 1)), PLANES)
    if planes >= count or not cuttable.is_stored:
        return whole(system, solve_of(None, None))
    light = volume.sum(axis=tuple(other for other in range(3) if other != axis), dtype=np.float64)
    middle = int(np.searchsorted(np.cumsum(light), light.sum() / 2))
    first = min(max(middle - planes // 2, 0), count - planes)
    along = np.arange(count).reshape([-1 if one == axis else 1 for one in range(3)])
    active = system.projector.active.mask
    kept = active & (along >= first) & (along < first + planes)
    unknowns = cuttable.active.compress(kept)
    rows = np.flatnonzero(cuttable @ unknowns.astype(np.float32) > 0)
    cut = cuttable.take(rows).of_unknowns(unknowns)  # few rows are quicker to cut
    pixels = [
        own[rows[(rows >= start) & (rows < stop)] - start]
        for own, (start, stop) in zip(system.pixels, pairwise(cuttable.view_ptr), strict=True)
    ]
    own = replace(system, projector=cut.on_voxel_means, pixels=tuple(pixels))
    low = first + FACES * (first > 0)
    high = first + planes - FACES * (first + planes < count)
    inside = kept & (along >= low) & (along < high)
    return Part(own, rows, solve_of(cut, rows), inside)
