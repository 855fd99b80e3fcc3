"""The parts of the benchmark: which studies each holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from _benchmark.consistent import consistent
from _benchmark.mismatch import mismatch
from _benchmark.plume import plume
from _benchmark.projectors import projectors
from _benchmark.scaling import scaling
from _benchmark.sizes import FULL, Sizes
from _benchmark.skipping import skipping
from _benchmark.solvers import Progress, Rows, solvers
from _benchmark.startup import startup

Part = Callable[[Sizes, Path | None, Progress], tuple[Rows, list[str]]]
"""Takes the sizes and the folder of real images; returns studies and what to know of them."""


def _projectors(sizes: Sizes, data: Path | None, progress: Progress) -> tuple[Rows, list[str]]:
    return {"projectors": projectors(sizes is not FULL, progress)}, []


def _solvers(sizes: Sizes, data: Path | None, progress: Progress) -> tuple[Rows, list[str]]:
    return solvers(sizes, progress) | {"consistent": consistent(sizes, progress)}, []


def _skipping(sizes: Sizes, data: Path | None, progress: Progress) -> tuple[Rows, list[str]]:
    rows = {"skipping": skipping(sizes, progress)}
    if data is None:
        return rows, ["The real plume was left out: no folder of real images was given (--data)."]
    return rows | {"plume": plume(data, sizes, progress)}, []


def _scaling(sizes: Sizes, data: Path | None, progress: Progress) -> tuple[Rows, list[str]]:
    return scaling(sizes, progress), []


def _startup(sizes: Sizes, data: Path | None, progress: Progress) -> tuple[Rows, list[str]]:
    return {"startup": startup(sizes, progress)}, []


def _mismatch(sizes: Sizes, data: Path | None, progress: Progress) -> tuple[Rows, list[str]]:
    return mismatch(sizes, progress), []


def _training(sizes: Sizes, data: Path | None, progress: Progress) -> tuple[Rows, list[str]]:
    from _benchmark.training import training  # torch, which the parts before should not meet

    return {"training": training(sizes, progress)}, []


PARTS: Mapping[str, Part] = {
    "projectors": _projectors,
    "solvers": _solvers,
    "skipping": _skipping,
    "scaling": _scaling,
    "startup": _startup,
    "mismatch": _mismatch,
    "training": _training,
}
