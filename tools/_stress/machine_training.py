"""Train in forks that are killed at random, each going on from what the one before left.

``python -m _stress.machine_training SCAN FOLDER TIMES ROUNDS SEED`` prints what was wrong as JSON.
It leaves ``FOLDER/whole/volume.npy``, which undisturbed training ends with, and in ``FOLDER/left``
what the last one that was killed left.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from _stress.machine_commands import partial_files
from _stress.machine_writers import fork, wait

VOLUME = "volume.npy"


def kill_training(scan: Path, folder: Path, times: int, rounds: int, seed: int) -> dict[str, Any]:
    """Kill training so many times; where it ends, it has to end with the same bits.

    Returns
    -------
    dict
        ``faults``, and how many ``went_on`` from a checkpoint.
    """
    random = np.random.default_rng(seed)
    _import_what_training_imports(scan, folder)
    began = time.perf_counter()
    if wait(fork(lambda: _train(scan, folder / "whole", rounds))):
        raise SystemExit("undisturbed training fails")
    seconds = time.perf_counter() - began
    expected = np.load(folder / "whole" / VOLUME)
    out, killed, went_on, faults = folder / "killed", 0, 0, []
    while killed < times and len(faults) < times:
        went_on += (out / "checkpoint.pt").exists()
        trainer = fork(lambda: _train(scan, out, rounds))
        time.sleep(seconds * random.uniform(0.5, 1.0))  # rays and voxels are traced before
        os.kill(trainer, signal.SIGKILL)
        code = wait(trainer)
        if code == -signal.SIGKILL:
            killed += 1
            continue
        faults += faults_of(code, out, expected)
        shutil.rmtree(out)
    out.mkdir(exist_ok=True)
    shutil.copytree(out, folder / "left")
    faults += faults_of(wait(fork(lambda: _train(scan, out, rounds))), out, expected)
    return {"faults": faults, "went_on": went_on}


def _import_what_training_imports(scan: Path, folder: Path) -> None:
    """Import it before there are forks: they are to be killed while they train."""
    names = folder / "imported.json"

    def train() -> None:
        _train(scan, folder / "first", 1)
        names.write_text(json.dumps(list(sys.modules)))

    if wait(fork(train)):
        raise SystemExit("the first training fails")
    for name in json.loads(names.read_text()):
        with suppress(ImportError):  # some are no files
            import_module(name)


def _train(scan: Path, out: Path, rounds: int) -> None:
    """Train as the command does, going on where there is a checkpoint; draw nothing."""
    from rigs.files import remove_leftovers
    from tomo import Scan
    from tomo.pipeline import reconstruct

    out.mkdir(exist_ok=True)
    remove_leftovers(out)
    outcome = reconstruct(
        Scan.load(scan),
        method="wernet",
        iterations=rounds,
        checkpoint=out / "checkpoint.pt",
        resume=True,
    )
    np.save(out / VOLUME, outcome.volume)


def faults_of(code: int, out: Path, expected: np.ndarray) -> list[str]:
    """Return what is wrong with where training ended."""
    if code:
        return [f"exit code {code}"]
    if left := partial_files(out):
        return [f"leaves {left[0]}"]
    return [] if np.array_equal(np.load(out / VOLUME), expected) else ["another end"]


if __name__ == "__main__":
    result = kill_training(Path(sys.argv[1]), Path(sys.argv[2]), *map(int, sys.argv[3:6]))
    sys.stdout.write(json.dumps(result))
