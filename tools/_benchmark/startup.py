"""What starting and first use cost: with nothing compiled yet, and with compiled code on disk."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from _benchmark.children import in_fresh_process
from _benchmark.scenes import scene
from _benchmark.sizes import TINY, Sizes
from _benchmark.solvers import Progress

CACHE = "NUMBA_CACHE_DIR"
WHOLE = "whole process"
IMPORTS = ("import tomo", "import libraries")


def startup(sizes: Sizes, progress: Progress) -> list[dict[str, Any]]:
    """Return the seconds of each step with an empty and with a warm cache of compiled code.

    Warm ones are medians; with an empty cache everything runs once, and only what ``sizes`` name.
    """
    with tempfile.TemporaryDirectory() as folder:
        cache, scan = Path(folder) / "cache", Path(folder) / "scan"
        scene("jet", 11, "clean", 0, TINY).scan.save(scan)
        asked = {
            "import tomo": ("import",),
            "kernels": ("kernels",),
            "reconstruct": ("reconstruct", str(scan)),
        }
        python = _python_starts(sizes.starts)
        rows = [{"what": "python", "step": WHOLE, "warm": python}]
        for number, (what, arguments) in enumerate(asked.items()):
            seconds: dict[str, dict[str, float]] = {}
            afresh = what in sizes.compile_afresh
            for turn, state in enumerate(("empty", "warm") if afresh else ("warm",)):
                progress(2 * number + turn, 2 * len(asked), f"{what}, {state} cache")
                own = {CACHE: str(cache / arguments[0])} if afresh else {}
                told = [
                    in_fresh_process("startup_child.py", *arguments, environment=own)
                    for _ in range(1 if state == "empty" else sizes.starts)
                ]
                seconds.setdefault(WHOLE, {})[state] = _median(told, "wall_seconds")
                for step in told[0]["steps"]:
                    taken = _median([one["steps"] for one in told], step)
                    seconds.setdefault(step, {})[state] = taken
            rows += [{"what": what, "step": step, **taken} for step, taken in seconds.items()]
        progress(2 * len(asked), 2 * len(asked), "")
    return rows


def first_use(rows: list[dict[str, Any]], cache: str) -> float:
    """Return the seconds that using every kernel once takes in all, imports aside.

    Parameters
    ----------
    rows : list of dict
        What `startup` returned.
    cache : {"empty", "warm"}
    """
    kernels = [row for row in rows if row["what"] == "kernels"]
    return sum(row.get(cache, 0.0) for row in kernels if row["step"] not in (WHOLE, *IMPORTS))


def _median(rows: list[dict[str, Any]], key: str) -> float:
    return statistics.median(row[key] for row in rows)


def _python_starts(times: int) -> float:
    taken = []
    for _ in range(times):
        started = time.perf_counter()
        subprocess.run([sys.executable, "-c", "pass"], check=True)
        taken.append(time.perf_counter() - started)
    return statistics.median(taken)
