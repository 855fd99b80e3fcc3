"""MLEM: maximum likelihood by expectation maximisation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.grouping import golden_section
from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.solvers._damping import damped
from tomo.solvers.iterate import States, check_measured, drive, multiplicative_start
from tomo.solvers.solution import Callback, Solution

BARELY_SEEN = 0.01
"""Share of the median voxel's column sum below which an update is damped."""


def ratio(measured: NDArray[np.float32], projected: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return ``measured / projected``, and 1 (no change) where nothing is projected.

    In double precision: the faint tail of a flame, 1e-40, would overflow a single.
    """
    one = np.ones(len(measured))
    return np.divide(measured, projected, out=one, where=projected > 0, dtype=np.float64)


def mlem(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 50,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    subsets: int = 1,
    callback: Callback | None = None,
) -> Solution:
    """Solve by MLEM: ``x <- x / (A^T 1) * A^T (b / A x)``.

    It climbs the likelihood of ``b`` as Poisson counts of mean ``A x`` and keeps the total
    intensity; voxels never become negative. Negative pixels count as zero.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,)
        The images, flat.
    iterations : int
    start : (voxels,), optional
        Must not be negative; a constant when None.
    nonnegative : bool
        Must be True: the method has no other form.
    subsets : int
        Above 1, each iteration updates once from each of as many interleaved parts of the pixels
        (every part sees all views), which makes one iteration nearly worth ``subsets``.
    callback : callable, optional
        ``callback(index, volume, relative_residual)``; returns True to stop.

    Notes
    -----
    A voxel that a subset barely sees is kept from running away by `sensitivity`.

    References
    ----------
    Shepp and Vardi, "Maximum likelihood reconstruction for emission tomography", IEEE
    Transactions on Medical Imaging 1 (1982), equation 2.13. Hudson and Larkin, "Accelerated image
    reconstruction using ordered subsets of projection data", ibid. 13 (1994).
    """
    check_nonnegative("mlem", nonnegative)
    measured = check_measured(projector, measured)
    counts = np.maximum(measured, 0)
    parts = interleaved(len(counts), subsets)
    blocks, fair = [], projector.column_sums / len(parts)
    for pixels in parts:
        block = projector.take(pixels) if subsets > 1 else projector
        blocks.append((block, counts[pixels], *sensitivity(block.column_sums, fair)))

    def states() -> States:
        x = multiplicative_start(projector, counts, start)
        while True:
            projected = projector @ x
            yield x, norm(measured - projected)
            for block, seen, per_column, missing in blocks:
                if subsets > 1:
                    projected = block @ x
                factor = per_column * (block.T @ ratio(seen, projected) + missing)
                x = (x * factor).astype(np.float32)

    return drive(
        states(),
        projector,
        measured,
        iterations=iterations,
        callback=callback,
        settings={"method": "mlem", "nonnegative": True, "subsets": subsets},
    )


def sensitivity(
    column_sums: NDArray[np.float64], fair: NDArray[np.float64] | float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what an update is divided by, as a factor, and what it lacks: ``(voxels,)`` each.

    A voxel that rays barely graze could grow without bound on noise that it has next to no part
    in. It is treated as if the length that it lacks to a hundredth of the median voxel's were
    seen by rays that agree with it: ``x (A^T ratio + m) / (A^T 1 + m)``, which leaves every fixed
    point and every well-seen voxel as it is. So is one whose rays are few in a subset: what its
    length lacks there to the ``fair`` share of all subsets is taken to agree, or the noise of the
    one ray that grazes it would be all of its update. A voxel that no ray crosses keeps its value.
    """
    missing = np.maximum(damped(column_sums, BARELY_SEEN), fair) - column_sums
    return 1 / (column_sums + missing), missing


def interleaved(count: int, parts: int) -> list[NDArray[np.int64]]:
    """Return ``parts`` ascending lists of the numbers below ``count``, each spread over all.

    Dealt out by the golden section, so that no part falls into step with the images' rows.
    """
    if not (1 <= parts <= max(count, 1) and parts % 1 == 0):
        raise ValueError(
            f"subsets: found {parts}, expected a whole number from 1 to that of pixels, {count}"
        )
    parts = int(parts)
    part = np.floor(golden_section(count) * parts).astype(np.int64)
    return [np.flatnonzero(part == number) for number in range(parts)]


def check_nonnegative(method: str, nonnegative: bool) -> None:
    """Refuse to run a multiplicative method without non-negativity."""
    if not nonnegative:
        raise ValueError(f"{method} nonnegative: found False, expected True (multiplicative)")
