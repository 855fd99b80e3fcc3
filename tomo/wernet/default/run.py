"""One run of the default WERNet from its first volume to the reason why it ended."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.operators import VOXEL
from tomo.solvers import Iteration
from tomo.solvers.solution import Callback
from tomo.wernet.default.checkpoint import Checkpoint, JudgedWeights, State
from tomo.wernet.default.outer_iterations import OuterIterations


class Record:
    """The history of a run, and the callback that sees it."""

    def __init__(self, callback: Callback | None) -> None:
        self.began, self.callback = time.perf_counter(), callback
        self.history: list[Iteration] = []
        self.volume = np.zeros(0, np.float32)  # the last; none yet

    def add(self, index: int, volume: NDArray[np.float32], residual: float) -> bool:
        """Add a volume (unknowns,); return whether the callback stops the run."""
        self.volume = volume
        self.history.append(Iteration(index, residual, time.perf_counter() - self.began))
        return bool(self.callback and self.callback(index, volume, residual))


def run(
    outer: OuterIterations,
    record: Record,
    saved: Checkpoint | None,
    state: State | None,
    *,
    train: bool,
    terms: bool,
) -> None:
    """Find parametric terms and do the outer iterations, until one of them says why they end.

    It goes on from ``state``, where there is one, unless nothing is to be learned. ``terms`` says
    whether parametric terms and the views' gains are looked for.
    """
    if saved and state is not None and not outer.stop_reason:
        with saved.damages():
            outer.restore(state)
    elif terms and outer.limit and not outer.stop_reason:
        found = outer.find_terms()
        if saved:
            saved.save(outer.state())
        if found and record.add(1, found.volume, found.training_residual):
            outer.stop_reason = "stopped by the callback after the parametric terms"
    blurred = outer.projector.basis == VOXEL and not outer.projector.rows_are_single_rays
    if blurred and train and not outer.stop_reason:
        outer.stop_reason = "no encoder is trained through a lens blur"
    while not outer.stop_reason and (outer.done < outer.limit or not (train or outer.done)):
        residual = outer.iterate(train=train)
        if math.isnan(residual):
            break
        if saved and train:
            saved.save(outer.state())
        if record.add(outer.done + outer.has_terms, outer.voxels, residual):
            outer.stop_reason = f"stopped by the callback after outer iteration {outer.done}"


def stop_message(stop_reason: str, kept: JudgedWeights | None, residuals: Sequence[float]) -> str:
    """Return in a line why the iterations ended and which weights are kept.

    Parameters
    ----------
    stop_reason : str
    kept : JudgedWeights or None
        None for the classic solve with segment lengths.
    residuals : (float, float)
        Relative residuals of left-out pixels, with segment lengths and with learned weights.
    """
    lengths, learned = residuals
    both = f"{learned:.4f}, segment lengths {lengths:.4f}"
    if kept is None and math.isnan(learned):
        return f"{stop_reason}; segment lengths are kept"
    if kept is None:
        return (
            f"{stop_reason}; segment lengths are kept: learned weights do not predict left-out "
            f"pixels surely better (relative residual {both})"
        )
    source = f"of outer iteration {kept.index}" if kept.index else "by parametric terms"
    return (
        f"{stop_reason}; learned weights {source} are kept (relative residual of left-out pixels "
        f"{both})"
    )
