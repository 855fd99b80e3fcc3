"""Timings that can be compared, in turn or in fresh processes, and the memory of processes."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

TOOLS = Path(__file__).resolve().parents[2]
HIGH_WATER = Path("/proc/self/status")
LIMIT = 900.0  # seconds; a process that takes longer hangs


def in_turn(candidates: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the median seconds of each candidate, the candidates run in turn.

    Whatever else slows the machine down for a while then slows all of them down alike. Each runs
    once before, unmeasured: compiled code is loaded and memory is touched.
    """
    for candidate in candidates.values():
        candidate()
    taken: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(repeats):
        for name, candidate in candidates.items():
            started = time.perf_counter()
            candidate()
            taken[name].append(time.perf_counter() - started)
    return {name: statistics.median(seconds) for name, seconds in taken.items()}


class Stopwatch:
    """Seconds of a clock since it was made, without those spent paused."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock, self._started = clock, clock()

    @contextmanager
    def paused(self) -> Iterator[float]:
        """Stand still, yielding what the watch shows: judging takes none of what is judged."""
        stopped = self._clock()
        try:
            yield stopped - self._started
        finally:
            self._started += self._clock() - stopped


def in_fresh_process(
    module: str, *arguments: str, environment: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Run a module in a fresh interpreter; return the JSON object that it prints, and its seconds.

    ``environment`` is set in addition to this process's. A RuntimeError ends with what a process
    that fails said last.
    """
    paths = (str(TOOLS.parent), str(TOOLS), os.environ.get("PYTHONPATH"))
    own = {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        env=os.environ | own | dict(environment or {}),
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    wall = time.perf_counter() - started
    if done.returncode:
        words = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise RuntimeError(f"{module} {' '.join(arguments)}: {words[-1]}")
    return {**json.loads(done.stdout or "{}"), "wall_seconds": wall}


def peak_resident() -> int:
    """Return the largest resident memory of this process so far, in bytes.

    From the kernel's high-water mark where there is one: ``ru_maxrss`` of a child begins with
    what its parent had when it forked.
    """
    try:
        line = next(x for x in HIGH_WATER.read_text("ascii").splitlines() if "VmHWM" in x)
        return int(line.split()[1]) * 1024
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def forget_the_peak() -> None:
    """Let the high-water mark begin anew where the system can: imports have a peak too."""
    try:
        Path("/proc/self/clear_refs").write_text("5", "ascii")
    except OSError:
        return
