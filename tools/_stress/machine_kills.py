"""Commands and writers that are killed, interrupted and started twice."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from _stress.machine_commands import (
    ROOT,
    partial_files,
    run,
    volume_in,
    wait,
    wait_until_heard,
)
from _stress.machine_kinds import KINDS
from _stress.machine_results import Results, files_of
from _stress.row import Progress, Row, Size, told

FULL = 20
"""Times that each writer, and training, is killed in a full run."""


def writers(folder: Path, size: Size, progress: Progress) -> Iterator[Row]:
    """Kill writers at random moments; the last good state has to load, and the next to work."""
    kinds = ("npz", "rig", "scan") if size.quick else tuple(KINDS)
    for done, kind in enumerate(kinds):
        progress(done, len(kinds), f"kill -9: {kind}")
        yield killed_writer(kind, folder / "written" / kind, 3 if size.quick else FULL, size.seed)


def killed_writer(kind: str, folder: Path, times: int, seed: int) -> Row:
    """Kill the writer of one kind of file so many times."""
    folder.mkdir(parents=True)
    found = _found_by("machine_writers", kind, folder, times, seed)
    note = f"{found['left']} left a temporary file, removed by the next; {found['new']} done"
    if found["between"]:
        note += f"; {found['between']} while files were moved, which the folder says"
    over = f"{times} times, at random"
    return Row.of_faults(f"kill -9 while writing: {kind}", over, found["faults"], note)


def training(scan: Path, folder: Path, size: Size, progress: Progress) -> Row:
    """Kill training, and resume it: the end has to be the same, bit for bit.

    In a full run the command goes on at last from where the library was killed.
    """
    times, rounds = (2, 2) if size.quick else (FULL, 4)
    folder = folder / "training"
    folder.mkdir()
    progress(0, times, "kill -9: training")
    found = _found_by("machine_training", scan, folder, times, rounds, size.seed)
    faults = found["faults"]
    if not size.quick:
        left = folder / "left"
        options = ("--method", "wernet", "--iterations", rounds, "--resume", "-o", left)
        fault = run("reconstruct", scan, *options).fault(0)
        if not fault and not np.array_equal(volume_in(left), np.load(folder / "whole/volume.npy")):
            fault = "the command ends elsewhere"
        faults += [f for f in (fault, *partial_files(left)) if f]
        if not found["went_on"]:
            faults.append("none was killed late enough to go on from a checkpoint")
    return Row.of_faults(
        "kill -9 in training with wernet, then --resume",
        f"{times} times, at random",
        faults,
        f"{found['went_on']} went on from a checkpoint; each end the same bits",
    )


def _found_by(module: str, *arguments: object) -> dict[str, Any]:
    """Return what a module that forks says of what it killed."""
    paths = f"{ROOT}{os.pathsep}{ROOT / 'tools'}"
    done = subprocess.run(
        [sys.executable, "-m", f"_stress.{module}", *map(str, arguments)],
        cwd=ROOT / "tools",
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=600,
    )
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no word"])[-1][:100]
        return {"faults": [said], "left": 0, "new": 0, "between": 0, "went_on": 0}
    return json.loads(done.stdout)


def signals(
    results: Results, earlier: Path, seconds: float, size: Size, progress: Progress
) -> Iterator[Row]:
    """Interrupt and terminate commands from their first import to their end.

    Parameters
    ----------
    results : Results
    earlier : Path
        A result, which stands in the folders written into.
    seconds : float
        How long such a command takes.
    """
    times, latest = (1, 0.5) if size.quick else (8, 1.1)  # the only one comes before the end
    random = np.random.default_rng(size.seed + 1)
    for name, one, code in (("Ctrl-C", signal.SIGINT, 130), ("SIGTERM", signal.SIGTERM, 143)):
        faults, stopped = [], 0
        for number in range(times):
            progress(number, times, name)
            moment = seconds * latest * (number + random.uniform(0.0, 1.0)) / times
            out = earlier.with_name(f"{one}-{number}")
            fault, is_stopped = stopped_run(results, earlier, out, one, code, moment)
            faults += [fault] if fault else []
            stopped += is_stopped
        if not stopped:
            faults.append("none was stopped")
        over = f"{times} times, from its first import to its end"
        yield Row.of_faults(f"{name} at random moments", over, faults,
                            f"{stopped} stopped, the others were done")  # fmt: skip


def stopped_run(
    results: Results, earlier: Path, out: Path, one: signal.Signals, code: int, moment: float
) -> tuple[str, bool]:
    """Send a signal to a command so many seconds after its first import.

    Returns
    -------
    fault : str
        Empty where it was done, or where one line and the exit code say that it was stopped and
        ``out`` holds the earlier result as it was, or the new one, whole.
    stopped : bool
    """
    shutil.copytree(earlier, out)
    began = time.perf_counter()
    process = results.start(out, 1)
    wait_until_heard(process)
    time.sleep(moment)
    process.send_signal(one)
    end = wait(process, began)
    fault = end.fault(0, code) or told(partial_files(out))
    if not fault and files_of(out) != files_of(earlier):
        fault = results.mixed(out)
    shutil.rmtree(out)
    return fault, end.code == code


def two_runs(results: Results, folder: Path, size: Size) -> tuple[Row, float]:
    """Run a command twice into one folder at the same time, into ``folder / "two-0"`` first.

    Returns
    -------
    row : Row
    seconds : float
        The shortest that two took.
    """
    times, faults, seconds = 1 if size.quick else 4, [], math.inf
    for number in range(times):
        out = folder / f"two-{number}"
        began = time.perf_counter()
        ends = [wait(process, began) for process in [results.start(out, n) for n in (1, 2)]]
        fault = told([end.fault(0) for end in ends]) or told(partial_files(out))
        faults += [f for f in (fault or results.mixed(out),) if f]
        seconds = min(seconds, max(end.seconds for end in ends))
    row = Row.of_faults("two runs into one folder at the same time", f"{times} times", faults)
    return row, seconds
