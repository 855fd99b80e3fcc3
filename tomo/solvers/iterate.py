"""What every solver shares: checks, start, history, callback, and the reason it stopped."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.solvers.solution import Callback, Iteration, Solution

States = Iterator[tuple[NDArray[np.float32], float]]
"""What a solver's generator yields: the flat volume and the norm of its residual."""


def check_measured(projector: ProjectionOperator, measured: ArrayLike) -> NDArray[np.float32]:
    """Return the measured pixels as a flat float32 vector.

    Raises
    ------
    ValueError
        If there are not as many pixels as the projector has rows, or some are not finite.
    """
    measured = _as_float32(measured).ravel()
    if len(measured) != projector.shape[0]:
        raise ValueError(
            f"measured: found {len(measured)} pixels, expected the projector's "
            f"{projector.shape[0]}"
        )
    wrong = np.count_nonzero(~np.isfinite(measured))
    if wrong:
        raise ValueError(f"measured: found {wrong} NaN or infinite pixels, expected finite ones")
    return measured


def additive_start(
    projector: ProjectionOperator, start: ArrayLike | None, nonnegative: bool
) -> NDArray[np.float32]:
    """Return a copy of ``start``, or zeros; ``nonnegative`` sets what is below zero to zero.

    Without that a voxel that no ray crosses would stay negative to the end.
    """
    if start is None:
        return np.zeros(projector.shape[1], np.float32)
    start = _checked_start(projector, start)
    return np.maximum(start, 0) if nonnegative else start


def multiplicative_start(
    projector: ProjectionOperator, measured: NDArray[np.float32], start: ArrayLike | None
) -> NDArray[np.float32]:
    """Return a copy of ``start``, or the constant that reproduces the sum of the images.

    Voxels that no ray crosses start at zero: nothing would ever change them.
    """
    if start is None:
        total = projector.row_sums.sum()
        level = max(float(measured.sum(dtype=np.float64)) / total, 0.0) if total > 0 else 0.0
        return np.where(projector.column_sums > 0, level, 0.0).astype(np.float32)
    start = _checked_start(projector, start)
    if (start < 0).any():
        raise ValueError("start: found negative voxels, expected none for a multiplicative method")
    return start


def _checked_start(projector: ProjectionOperator, start: ArrayLike) -> NDArray[np.float32]:
    start = _as_float32(start)
    unknowns, voxels = projector.shape[1], projector.grid.size
    if start.size not in (unknowns, voxels) or not np.isfinite(start).all():
        raise ValueError(
            f"start: found shape {start.shape}, expected a finite volume of "
            f"{projector.grid.shape} voxels"
        )
    flat = start.ravel()
    return (projector.active.compress(flat) if start.size == voxels else flat).copy()


def _as_float32(array: ArrayLike) -> NDArray[np.float32]:
    """Return ``array`` in single precision; what is too large becomes infinite, for checks."""
    with np.errstate(over="ignore"):
        return np.asarray(array).astype(np.float32, copy=False)


def residual_of(
    projector: ProjectionOperator, measured: NDArray[np.float32], x: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return ``b - A x``; nothing is projected of zeros."""
    return measured - projector @ x if x.any() else measured


def unit_of(vector: NDArray[np.float32]) -> np.float32:
    """Return the power of two next below the largest magnitude; 1 for a vector of zeros.

    Dividing by it is exact, and keeps what grows with the square of the intensity or with the
    size of the system inside the range of single precision.
    """
    largest = float(np.abs(vector).max(initial=0.0))
    return np.float32(2.0 ** (math.frexp(largest)[1] - 1)) if largest > 0 else np.float32(1)


def drive(
    states: States,
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    *,
    iterations: int,
    callback: Callback | None,
    settings: Mapping[str, Any],
) -> Solution:
    """Run a solver's generator for at most ``iterations`` updates and record what happens.

    The generator yields the state after 0, 1, 2 ... updates; each is reported to ``callback`` as
    it is, one value a active voxel. What is returned covers the grid, zero where no voxel is
    active.

    Raises
    ------
    ValueError
        If ``iterations`` is not a whole number or negative, or not even the first volume that is
        not dark can be written in single precision.
    """
    if not (iterations >= 0 and iterations % 1 == 0):
        raise ValueError(f"iterations: found {iterations}, expected a whole number >= 0")
    scale = norm(measured) or 1.0
    started = time.perf_counter()
    history: list[Iteration] = []
    stop_reason = f"all {iterations} iterations done"
    volume = np.zeros(projector.shape[1], np.float32)
    for index, (state, residual_norm) in enumerate(_quietly(states)):
        relative = residual_norm / scale
        if not (np.isfinite(relative) and np.isfinite(state).all()):
            if not volume.any():
                raise ValueError(
                    "measured: found intensities whose volume overflows single precision, "
                    "expected smaller numbers: a larger unit"
                )
            stop_reason = f"diverged at iteration {index}; the volume is that of the one before"
            break
        volume = state
        history.append(Iteration(index, relative, time.perf_counter() - started))
        if callback is not None and callback(index, volume, relative):
            stop_reason = f"stopped by the callback at iteration {index}"
            break
        if index == iterations:
            break
    else:
        stop_reason = f"converged at iteration {len(history) - 1}"
    return Solution(
        volume=projector.active.expand(volume).reshape(projector.grid.shape).copy(),
        grid=projector.grid,
        history=tuple(history),
        settings={**settings, "iterations": iterations},
        stop_reason=stop_reason,
        seconds={"solve": time.perf_counter() - started},
    )


def _quietly(states: States) -> States:
    """Go through the states; where numbers overflow, that is seen in them and not warned of."""
    while True:
        with np.errstate(over="ignore", invalid="ignore"):
            found = next(states, None)
        if found is None:
            return
        yield found


def check_relaxation(relaxation: float) -> float:
    """Return the relaxation factor; the methods that take one converge for 0 < factor < 2."""
    if not 0 < relaxation < 2:
        raise ValueError(f"relaxation: found {relaxation}, expected above 0 and below 2")
    return float(relaxation)
