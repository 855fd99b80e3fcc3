"""The loop that every solver runs in, and the parameters that solvers share.

A pass may go through interleaved subsets of the pixels, each of which sees all views.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import all_finite, host, namespace
from tomo._compute.grouping import golden_ratio_sequence
from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.solvers.solution import Callback, Iteration, Solution


def interleaved(count: int, parts: int) -> list[NDArray[np.int64]]:
    """Return ``parts`` ascending lists of the numbers below ``count``, each spread over all.

    Dealt out by the golden-ratio sequence, so that no part falls into step with the images' rows.
    """
    if not (1 <= parts <= max(count, 1) and parts % 1 == 0):
        raise ValueError(
            f"subsets: found {parts}, expected a whole number from 1 to that of pixels, {count}"
        )
    parts = int(parts)
    part = np.floor(golden_ratio_sequence(count) * parts).astype(np.int64)
    return [np.flatnonzero(part == number) for number in range(parts)]


States = Iterator[tuple[NDArray[np.float32], float]]
"""The states of a solver: the volume ``(unknowns,)`` and the norm of its residual."""


def residual_of(
    projector: ProjectionOperator, measured: NDArray[np.float32], x: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return ``b - A x``; zeros are not projected."""
    return measured - projector @ x if bool(namespace(x).any(x)) else measured


def drive(
    states: States,
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    iterations: int,
    callback: Callback | None,
    settings: Mapping[str, Any],
) -> Solution:
    """Run a solver's generator for at most ``iterations`` updates and record what happens.

    The generator yields the state after 0, 1, 2 ... updates; each is passed to ``callback`` as it
    is, one value an active voxel, on a device where products are computed there. The volume of the
    solution covers the grid, zero where no voxel is active, in NumPy's array. ValueError: the
    first volume that is not dark overflows single precision.
    """
    if not (iterations >= 0 and iterations % 1 == 0):
        raise ValueError(f"iterations: found {iterations}, expected a whole number >= 0")
    scale = norm(measured) or 1.0
    started = time.perf_counter()
    history: list[Iteration] = []
    stop_reason = f"all {iterations} iterations done"
    volume: Any = np.zeros(projector.shape[1], np.float32)
    for index, (state, residual_norm) in enumerate(_quietly(states, projector)):
        relative = residual_norm / scale
        if not (np.isfinite(relative) and all_finite(state)):
            if not host(volume).any():
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
        volume=projector.active.expand(host(volume)).reshape(projector.grid.shape).copy(),
        grid=projector.grid,
        history=tuple(history),
        settings={**settings, "iterations": iterations},
        stop_reason=stop_reason,
        seconds={"solve": time.perf_counter() - started},
    )


def _quietly(states: States, projector: ProjectionOperator) -> States:
    """Go through the states without warnings of overflow: the states show it."""
    while True:
        with projector.computing(), np.errstate(over="ignore", invalid="ignore"):
            found = next(states, None)
        if found is None:
            return
        yield found


def check_relaxation(relaxation: float) -> float:
    """Return the relaxation factor; methods converge for 0 < factor < 2."""
    if not 0 < relaxation < 2:
        raise ValueError(f"relaxation: found {relaxation}, expected above 0 and below 2")
    return float(relaxation)


def check_nonnegative(method: str, nonnegative: bool) -> None:
    """Refuse to run a multiplicative method without non-negativity."""
    if not nonnegative:
        raise ValueError(f"{method} nonnegative: found False, expected True (multiplicative)")


SHARED = {
    "projector": "projector : ProjectionOperator\n    ``A``, from the unknowns to the pixels.",
    "stored_projector": (
        "projector : Projector\n    ``A``, stored: the method goes through its rows."
    ),
    "measured": "measured : (pixels,)\n    ``b``, the images, flat.",
    "iterations": "iterations : int\n    Updates of the volume.",
    "start": "start : (voxels,), optional\n    The first volume; zeros when None.",
    "positive_start": (
        "start : (voxels,), optional\n    The first volume, not negative; a constant when None."
    ),
    "nonnegative": (
        "nonnegative : bool\n    Whether to search among volumes ``x >= 0`` only: ``max(x, 0)``."
    ),
    "always_nonnegative": (
        "nonnegative : bool\n    Must be True: a multiplicative method has no other form."
    ),
    "weights": (
        "weights : (pixels,), optional\n"
        "    The diagonal of ``W``, such as the inverse variances of the pixels; ones when None.\n"
        "    With weights the history holds ``||W^½ (b - A x)|| / ||W^½ b||``."
    ),
    "relaxation": "relaxation : float\n    ``r``, above 0 and below 2.",
    "strength": "strength : float\n    ``s``, >= 0, without a unit: how much the prior counts.",
    "seed": "seed : int\n    Seed of the order of the pixels.",
    "callback": (
        "callback : callable, optional\n"
        "    ``callback(index, volume, relative_residual)``; returns True to stop."
    ),
}
"""Paragraphs of a numpy docstring, by the name that stands in braces where they go."""


def shared_parameters(solver: Callable) -> Callable:
    """Fill in the paragraphs of `SHARED` that a solver's docstring names in braces, a line each.

    Lines indented below a name in braces go on with its paragraph.
    """
    if solver.__doc__:  # there is none under python -OO
        for name, paragraph in SHARED.items():
            lines = paragraph.replace("\n", "\n    ")
            solver.__doc__ = solver.__doc__.replace(f"    {{{name}}}\n", f"    {lines}\n")
    return solver
