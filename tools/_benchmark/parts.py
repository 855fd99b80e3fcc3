"""The parts of the benchmark: which studies each holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _benchmark.basis import basis
from _benchmark.consistent import consistent
from _benchmark.mismatch import mismatch
from _benchmark.plume import plume
from _benchmark.projectors import projectors
from _benchmark.scaling import scaling
from _benchmark.sizes import FULL, Sizes
from _benchmark.skippable import skippable
from _benchmark.skipping import skipping
from _benchmark.solvers import Progress, Rows, solvers
from _benchmark.startup import startup


@dataclass(frozen=True, eq=False)
class Asked:
    """What a part is given.

    Attributes
    ----------
    sizes : Sizes
    progress : callable
    data : Path, optional
        The folder of real images.
    processes : int
        How many may work side by side on what is not timed.
    kept : sequence of mapping
        The rows of a part that was interrupted.
    keep : callable
        Takes all rows so far of a part that may be interrupted between them.
    """

    sizes: Sizes
    progress: Progress
    data: Path | None = None
    processes: int = 1
    kept: Sequence[Mapping[str, Any]] = ()
    keep: Callable[[list[dict[str, Any]]], None] = lambda rows: None


Part = Callable[[Asked], tuple[Rows, list[str]]]
"""Returns studies and what to know of them."""


def _projectors(asked: Asked) -> tuple[Rows, list[str]]:
    return {"projectors": projectors(asked.sizes is not FULL, asked.progress)}, []


def _solvers(asked: Asked) -> tuple[Rows, list[str]]:
    sizes, progress = asked.sizes, asked.progress
    return solvers(sizes, progress) | {"consistent": consistent(sizes, progress)}, []


def _skipping(asked: Asked) -> tuple[Rows, list[str]]:
    sizes, progress = asked.sizes, asked.progress
    rows = {"skipping": skipping(sizes, progress), "skippable": skippable(sizes, progress)}
    if asked.data is None:
        return rows, ["The real plume was left out: no folder of real images was given (--data)."]
    return rows | {"plume": plume(asked.data, sizes, progress)}, []


def _basis(asked: Asked) -> tuple[Rows, list[str]]:
    return basis(asked.sizes, asked.progress), []


def _scaling(asked: Asked) -> tuple[Rows, list[str]]:
    return scaling(asked.sizes, asked.progress), []


def _startup(asked: Asked) -> tuple[Rows, list[str]]:
    return {"startup": startup(asked.sizes, asked.progress)}, []


def _mismatch(asked: Asked) -> tuple[Rows, list[str]]:
    rows = mismatch(
        asked.sizes,
        asked.progress,
        kept=asked.kept,
        keep=asked.keep,
        processes=asked.processes,
    )
    notes = []
    if asked.processes > 1:
        notes += [f"{asked.processes} scenes at a time, a thread each: seconds of a busy machine."]
    if asked.kept:
        notes += [f"{len(asked.kept)} scenes were there from a run that was interrupted."]
    return rows, notes


def _training(asked: Asked) -> tuple[Rows, list[str]]:
    from _benchmark.training import training  # torch, which the parts before should not meet

    return {"training": training(asked.sizes, asked.progress)}, []


PARTS: Mapping[str, Part] = {
    "projectors": _projectors,
    "solvers": _solvers,
    "skipping": _skipping,
    "basis": _basis,
    "scaling": _scaling,
    "startup": _startup,
    "mismatch": _mismatch,
    "training": _training,
}
