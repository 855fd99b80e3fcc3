"""Threads and repeats: the same bits, whatever a machine has and however often one asks."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.common.study import Request, Tables
from studies.common.timing import in_fresh_process
from studies.stress.row import COLUMNS, Row, measured, relative_error, worst_of
from studies.stress.scene import jet_by, ring
from tomo.simulation.effects import Effects

__all__ = ["COLUMNS", "run"]

POOLS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
CHILD = "studies.stress.threads_child"


@dataclass(frozen=True, eq=False)
class Made:
    """What one process made.

    Attributes
    ----------
    threads : int
    hashes : mapping of str to str
        By name, the SHA-256 of every result.
    volume : (nx, ny, nz) float32
        Of the default method or of WERNet.
    """

    threads: int
    hashes: Mapping[str, str]
    volume: NDArray[np.float32]


def run(request: Request) -> Tables:
    """Measure the rows of this part."""
    return measured(_rows(request))


def _rows(request: Request) -> Iterator[Row]:
    quick, progress = request.size != "full", request.progress
    counts = (1, 4, 4) if quick else (1, 2, 4, 8, 2)
    learned = (1, 2, 2) if quick else (1, 2, 4, 2)
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(2) as pool:
        classic, wernet = Path(name, "classic"), Path(name, "learned")
        _scan(classic, 9 if quick else 21, Effects())
        _scan(wernet, 6, Effects(absorption=0.3))
        # what a process does alone, importing most of all, leaves the other cores to the next
        jobs = [pool.submit(made_by, threads, classic) for threads in counts]
        jobs += [pool.submit(made_by, threads, wernet, "wernet") for threads in learned]
        made = []
        for number, job in enumerate(jobs):
            progress(number, len(jobs), "processes")
            made.append(job.result())
        yield from classic_rows(made[: len(counts)])
        yield from learned_rows(made[len(counts) :])
        progress(len(jobs), len(jobs), "")


def made_by(threads: int, scan: Path, *what: str) -> Made:
    """Run the child with so many threads."""
    environment = dict.fromkeys(POOLS, str(threads))
    with tempfile.TemporaryDirectory() as folder:
        volume = Path(folder, "volume.npy")
        arguments = (str(scan), str(volume), *what)
        hashes = in_fresh_process(CHILD, *arguments, environment=environment)
        del hashes["wall_seconds"]
        return Made(threads, hashes, np.load(volume, allow_pickle=False))


def classic_rows(made: Sequence[Made]) -> Iterator[Row]:
    """Compare all processes with the first; the last has as many threads as one before it."""
    first = made[0]
    whole = [name for name in first.hashes if "@" not in name]
    over = f"{_listed(made[:-1])} threads, {len(whole)} results"
    differing = [
        f"{name}, {one.threads} threads"
        for one in made[1:-1]
        for name in whole
        if one.hashes.get(name) != first.hashes[name]
    ]
    yield Row(
        "every classic method, default method, carving, effects, simulation, by threads",
        over,
        len(differing),
        0,
        "results with other bits",
        note="; ".join(differing[:5]),
    )
    fewer = [
        f"{name} of {one.threads}"
        for one in made
        for name, found in one.hashes.items()
        if "@" in name and found != one.hashes[name.split(" @")[0]]
    ]
    yield Row(
        "some of a process's threads, stored and on the fly",
        f"1 to {max(one.threads for one in made)} threads",
        len(fewer),
        0,
        "results with other bits",
        note="; ".join(fewer[:5]),
    )
    again = _as_the_last(made)
    repeated = [name for name in whole if again.hashes.get(name) != made[-1].hashes.get(name)]
    yield Row(
        "the same once more, in another process",
        f"{made[-1].threads} threads, {len(whole)} results",
        len(repeated),
        0,
        "results with other bits",
        note="; ".join(repeated[:5]),
    )


def learned_rows(made: Sequence[Made]) -> Iterator[Row]:
    """Compare what WERNet made: the same bits on as many threads, nearly so on others."""
    again, last = _as_the_last(made), made[-1]
    yield Row(
        "WERNet once more, in another process",
        f"{last.threads} threads",
        float(np.count_nonzero(again.volume != last.volume)),
        0,
        "voxels with other bits",
    )
    worst, where = worst_of(
        (f"{one.threads} threads", relative_error(one.volume, made[0].volume)) for one in made[1:]
    )
    yield Row(
        "WERNet by threads", f"{_listed(made[:-1])} threads", worst, 1e-4,
        f"relative to {made[0].threads} thread", note=where,
    )  # fmt: skip


def _as_the_last(made: Sequence[Made]) -> Made:
    return next(one for one in made[:-1] if one.threads == made[-1].threads)


def _scan(folder: Path, cameras: int, effects: Effects) -> None:
    noise = 0.0 if effects.any else 0.02
    jet_by(ring(cameras), noise=noise, effects=effects, seed=1).save(folder)


def _listed(made: Sequence[Made]) -> str:
    return ", ".join(str(one.threads) for one in made)
