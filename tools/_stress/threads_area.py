"""Threads and repeats: the same bits, whatever a machine has and however often one asks."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from _stress.row import Progress, Row, Size, relative_error, worst_of
from _stress.values_scene import ring, simulated_by
from tomo.simulation.effects import Effects

POOLS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
CHILD = Path(__file__).with_name("threads_child.py")
LONGEST = 300  # seconds a process may take


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


def rows(size: Size, progress: Progress) -> Iterator[Row]:
    """Yield the rows of the area."""
    counts = (1, 4, 4) if size.quick else (1, 2, 4, 8, 2)
    learned = (1, 2, 2) if size.quick else (1, 2, 4, 2)
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(2) as pool:
        classic, wernet = Path(name, "classic"), Path(name, "learned")
        _scan(classic, 9 if size.quick else 21, Effects())
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
    """Run the child with so many threads.

    Raises
    ------
    RuntimeError
        With the last line that it said, where it failed.
    """
    environment = os.environ | dict.fromkeys(POOLS, str(threads))
    environment.pop("NUMBA_THREADING_LAYER", None)
    with tempfile.TemporaryDirectory() as folder:
        volume = Path(folder, "volume.npy")
        command = [sys.executable, str(CHILD), str(scan), str(volume), *what]
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=LONGEST, check=False
        )
        if done.returncode != 0:
            last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
            raise RuntimeError(f"{threads} threads: {last}")
        return Made(threads, json.loads(done.stdout), np.load(volume, allow_pickle=False))


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
        "every classic method, default method, carving, gains, alignment, simulation, by threads",
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
    simulated_by(ring(cameras), noise=noise, effects=effects, seed=1).save(folder)


def _listed(made: Sequence[Made]) -> str:
    return ", ".join(str(one.threads) for one in made)
