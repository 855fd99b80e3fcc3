"""What starting and first use cost: with nothing compiled yet, and with compiled code on disk.

Seconds of fresh processes; "warm" ones are medians, with an empty cache of compiled code each
runs once. `kernels` traces and projects in both forms and runs one iteration of every solver,
`reconstruct` is the default on a tiny scan.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from studies.benchmark.sizes import SIZES
from studies.common.flames import scene
from studies.common.study import Request, Tables
from studies.common.timing import in_fresh_process

CACHE = "NUMBA_CACHE_DIR"
WHOLE = "whole process"

COLUMNS = {"startup": "what step empty warm"}


def run(request: Request) -> Tables:
    """Return the seconds of each step with an empty and with a warm cache of compiled code."""
    sizes = SIZES[request.size]
    with tempfile.TemporaryDirectory() as folder:
        cache, scan = Path(folder) / "cache", Path(folder) / "scan"
        scene("jet", 11, "clean", 0, SIZES["tiny"].flame).scan.save(scan)
        asked = {
            "import tomo": ("import",),
            "kernels": ("kernels",),
            "reconstruct": ("reconstruct", str(scan)),
        }
        rows = [{"what": "python", "step": WHOLE, "warm": _python_starts(sizes.starts)}]
        for number, (what, arguments) in enumerate(asked.items()):
            seconds: dict[str, dict[str, float]] = {}
            afresh = what in sizes.afresh
            for state in ("empty", "warm") if afresh else ("warm",):
                request.progress(number, len(asked), f"{what}, {state} cache")
                own = {CACHE: str(cache / arguments[0])} if afresh else {}
                runs = [
                    in_fresh_process(
                        "studies.benchmark.startup_child", *arguments, environment=own
                    )
                    for _ in range(1 if state == "empty" else sizes.starts)
                ]
                seconds.setdefault(WHOLE, {})[state] = _median(runs, "wall_seconds")
                for step in runs[0]["steps"]:
                    taken = _median([one["steps"] for one in runs], step)
                    seconds.setdefault(step, {})[state] = taken
            rows += [{"what": what, "step": step, **taken} for step, taken in seconds.items()]
    return {"startup": rows}


def _median(rows: list[dict[str, Any]], key: str) -> float:
    return statistics.median(row[key] for row in rows)


def _python_starts(times: int) -> float:
    taken = []
    for _ in range(times):
        started = time.perf_counter()
        subprocess.run([sys.executable, "-c", "pass"], check=True)
        taken.append(time.perf_counter() - started)
    return statistics.median(taken)
