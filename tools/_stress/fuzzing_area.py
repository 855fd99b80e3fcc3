"""Fuzzing: damaged and hostile files for every reader, guided by the lines that they reach."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from _stress.fuzzing_guard import LIMIT, MEMORY
from _stress.fuzzing_readers import NAMES, OFTEN, in_groups
from _stress.fuzzing_rig_readers import MOST_RAYS
from _stress.row import Progress, Row, Size

FULL, QUICK = 6000, 60  # inputs a reader
_ALL = 200_000  # inputs that a full run has to have tried
_SILENCE = 120.0  # seconds after which a process hangs where no signal reaches it
_MEGABYTE = 1 << 20


def rows(size: Size, progress: Progress) -> Iterator[Row]:
    """Yield a row for each reader, and what holds for all."""
    reports = run(NAMES, QUICK if size.quick else FULL, size.seed, progress)
    for name in NAMES:
        report = reports[name]
        yield Row(
            f"Reader of {name}",
            f"{report['inputs']} inputs, {report['statements']} statements reached",
            sum(report["faults"].values()),
            0,
            "faults",
            note=_told(report["faults"]),
        )
    every = list(reports.values())
    inputs, reached = (sum(report[key] for report in every) for key in ("inputs", "statements"))
    least = len(NAMES) * QUICK if size.quick else _ALL
    over = f"{len(NAMES)} readers, {reached} statements reached"
    yield Row("Inputs in all", over, inputs, least, "inputs", at_least=True)
    over = f"{inputs} inputs"
    for stress, words in (
        ("Files written by readers", "wrote"),
        ("Code executed from files", "executed"),
        ("Processes that crashed or hung", "crashed"),
        ("Errors other than one line of ValueError or OSError", ""),
    ):
        counts = {
            f"{report['reader']}: {what}": count
            for report in every
            for what, count in report["faults"].items()
            if what.startswith(words)
            and (words or not what.startswith(("wrote", "executed", "crashed", "TooLong")))
            and (words or "beyond four times" not in what)
        }
        yield Row(stress, over, sum(counts.values()), 0, "faults", note=_told(counts))
    slowest = max(every, key=lambda report: report["slowest"])
    yield Row("Slowest reading", over, slowest["slowest"], LIMIT, "s", note=slowest["reader"])
    largest = max(every, key=lambda report: report["memory"])
    yield Row(
        "Most memory beyond four times the file",
        f"{over}; tables of rays of at most {MOST_RAYS} pixels: they take memory by the camera's "
        "pixels, whatever the file's size, and 2^24 is the most outside this test",
        largest["memory"] / _MEGABYTE,
        MEMORY / _MEGABYTE,
        "MB",
        note=largest["reader"],
    )


def run(
    names: tuple[str, ...],
    inputs: int,
    seed: int = 0,
    progress: Progress = lambda done, total, where: None,
    keep: Path | None = None,
) -> dict[str, dict[str, Any]]:
    """Fuzz readers in two processes and return their reports.

    Parameters
    ----------
    names : sequence of str
        Of the readers.
    inputs : int
        For each; twice as many for those in ``OFTEN``.
    seed : int
    progress : Progress
    keep : Path, optional
        A folder for the inputs that gave a fault.
    """
    waiting = deque(in_groups(names))
    reports: dict[str, dict[str, Any]] = {}

    def work(following: Callable[[], str]) -> None:
        with tempfile.TemporaryDirectory() as scratch:
            child = _Child(Path(scratch), keep)
            while True:
                try:
                    name = following()
                except IndexError:
                    child.end()
                    return
                reports[name] = child.fuzz(name, inputs * (1 + (name in OFTEN)), seed)
                progress(len(reports), len(names), name)

    with ThreadPoolExecutor(2) as pool:
        # from both ends: what a group of readers imports and writes is needed once, mostly
        for future in [pool.submit(work, end) for end in (waiting.popleft, waiting.pop)]:
            future.result()
    return reports


class _Child:
    """A process that fuzzes; another takes its place where it crashes."""

    def __init__(self, scratch: Path, keep: Path | None):
        self._errors = scratch / "errors"
        self._keep = [] if keep is None else [str(keep)]
        self._process: subprocess.Popen | None = None

    def fuzz(self, name: str, inputs: int, seed: int) -> dict[str, Any]:
        """Return the report of a reader, of several processes where some crash."""
        report = {"reader": name, "inputs": 0, "statements": 0, "slowest": 0.0, "memory": 0}
        report["faults"] = {}
        while report["inputs"] < inputs:
            left = inputs - report["inputs"]
            last, crash = self._ask({"reader": name, "inputs": left, "seed": seed})
            report["inputs"] += last.get("inputs", 0) + bool(crash)
            for key in ("statements", "slowest", "memory"):
                report[key] = max(report[key], last.get(key, 0))
            for what, count in {**last.get("faults", {}), **({crash: 1} if crash else {})}.items():
                report["faults"][what] = report["faults"].get(what, 0) + count
            seed += 1 << 20  # the same inputs would crash it again
        return report

    def end(self) -> None:
        """Let the process end."""
        if self._process is not None:
            self._process.stdin.close()
            self._process.wait(_SILENCE)
            self._process.stdout.close()
            self._process = None

    def _ask(self, job: dict[str, Any]) -> tuple[dict[str, Any], str]:
        """Return the last that was heard of a job, and how the process ended if it did."""
        if self._process is None:
            self._process = self._started()
        process, last = self._process, {}
        process.stdin.write(json.dumps(job).encode() + b"\n")
        process.stdin.flush()
        with selectors.DefaultSelector() as ready:
            ready.register(process.stdout, selectors.EVENT_READ)
            while ready.select(_SILENCE):
                line = process.stdout.readline()
                if not line:
                    break
                last = json.loads(line)
                if last["done"]:
                    return last, ""
        hangs = process.poll() is None
        process.kill()
        code = process.wait()
        process.stdin.close()
        process.stdout.close()
        self._process = None
        said = self._errors.read_text(errors="replace").strip().splitlines()[-1:]
        how = f"no answer for {_SILENCE:g} s" if hangs else f"exit code {code}"
        return last, f"crashed: {how} {' '.join(said)}".strip()

    def _started(self) -> subprocess.Popen:
        script = Path(__file__).with_name("fuzzing_child.py")
        paths = (str(script.parents[2]), str(script.parents[1]), os.environ.get("PYTHONPATH"))
        one = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "NUMBA", "OPENBLAS", "MKL")}
        with self._errors.open("wb") as errors:
            return subprocess.Popen(
                [sys.executable, str(script), *self._keep],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                bufsize=0,
                env={
                    **os.environ,
                    **one,
                    "PYTHONHASHSEED": "0",
                    "PYTHONPATH": os.pathsep.join(filter(None, paths)),
                },
            )


def _told(faults: dict[str, int]) -> str:
    """Return the most frequent faults."""
    often = sorted(faults.items(), key=lambda pair: -pair[1])
    return "; ".join(f"{count} x {what}" for what, count in often[:4])
