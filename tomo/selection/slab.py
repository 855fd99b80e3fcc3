"""A slab of a large volume, with the rays that mostly run in it: enough to choose by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.selection.smooth_solve import smooth_start

SEGMENTS = 2_500_000
"""Segments above which a slab of the volume is solved instead of all of it. A thinner one is
mostly borders, where priors take the dark for an edge; a thicker one takes its time."""

MOSTLY = 0.5
"""Fraction of a ray's length in the slab from which on its pixel takes part."""


@dataclass(frozen=True, eq=False)
class Part:
    """The equations of a part of the volume, light of the rest taken away.

    Attributes
    ----------
    projector : ProjectionOperator
    measured : (pixels,) float32
    pixels : (pixels,) int64
        Which of all pixels these are.
    """

    projector: ProjectionOperator
    measured: NDArray[np.float32]
    pixels: NDArray[np.int64]


def part_to_choose_by(projector: ProjectionOperator, measured: NDArray[np.float32]) -> Part | None:
    """Return a slab through the middle of the emission; None where all of it is small enough.

    The slab goes across the axis along which the fewest rays leave it. Light from the rest is
    that of `smooth_start`. Only stored projections can be cut.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,) float32
    """
    wanted = SEGMENTS / max(_segments_of_single_rays(projector), 1)
    if wanted >= 1 or not projector.is_stored:
        return None
    start = smooth_start(projector, measured)
    lengths = projector.row_sums
    slabs = [_slab(projector, start, axis, wanted) for axis in range(3)]
    inside = [projector @ slab.astype(np.float64) for slab in slabs]
    mostly = [one > MOSTLY * lengths for one in inside]
    leaving = [
        (lengths[rays] - one[rays]).sum() / max(one[rays].sum(), np.finfo(float).tiny)
        for one, rays in zip(inside, mostly, strict=True)
    ]
    best = int(np.argmin(leaving))
    slab, pixels = slabs[best], np.flatnonzero(mostly[best])
    if not slab.any() or not len(pixels):
        return None
    rest = projector @ np.where(slab, np.float32(0), start)
    cut = projector.of_unknowns(slab).take(pixels)
    return Part(cut, (measured - rest)[pixels], pixels)


def _segments_of_single_rays(projector: ProjectionOperator) -> float:
    """Return at most how many segments one ray a pixel would have.

    Rays over a pixel's area or an aperture multiply the segments, not what the slab shows. A ray
    of length ``l`` crosses at most ``l |(1/dx, 1/dy, 1/dz)| + 1`` voxels.
    """
    steps = float(np.linalg.norm(1 / np.asarray(projector.grid.spacing)))
    lengths = projector.row_sums
    longest = steps * float(lengths.sum(dtype=np.float64)) + np.count_nonzero(lengths)
    return min(projector.n_segments, longest)


def _slab(
    projector: ProjectionOperator, emission: NDArray[np.float32], axis: int, wanted: float
) -> NDArray[np.bool_]:
    """Return the unknowns of the planes around the middle of the emission, ``(unknowns,)`` bool.

    As many planes as hold about the fraction ``wanted`` of all rays' lengths.
    """
    active, others = projector.active, tuple(a for a in range(3) if a != axis)

    def planes(values: NDArray) -> NDArray[np.float64]:
        return active.expand(values).reshape(active.grid.shape).sum(axis=others, dtype=np.float64)

    light, work = planes(emission), planes(projector.column_sums)
    middle = int(np.searchsorted(np.cumsum(light), light.sum() / 2))
    order = np.argsort(np.abs(np.arange(len(work)) - middle), kind="stable")
    taken = order[: max(int(np.searchsorted(np.cumsum(work[order]), wanted * work.sum())), 1)]
    kept = np.zeros(active.grid.shape, bool)
    kept[tuple(taken if a == axis else slice(None) for a in range(3))] = True
    return active.compress(kept)
