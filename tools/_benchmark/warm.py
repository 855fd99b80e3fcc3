"""Compile or load everything once, so that no figure holds first use."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from _benchmark.courses import course
from _benchmark.problems import problem
from _benchmark.scenes import scene
from _benchmark.sizes import TINY
from _benchmark.solvers import settings_of
from tomo import solvers
from tomo.pipeline import reconstruct


def warm_up() -> float:
    """Reconstruct a tiny flame by every method; return the seconds that took."""
    started = time.perf_counter()
    seen = scene("jet", 11, "gaussian", 0, TINY)
    rig, grid = seen.scan.rig, seen.scan.grid
    problem(rig, grid, seen.images, skip=True, form="on-the-fly")
    ready = problem(rig, grid, seen.images, skip=True)
    for method in solvers.METHODS:
        for settings in settings_of(method, 2):
            course(ready, seen.scan.truth, method, settings, passes=2)
    with tempfile.TemporaryDirectory() as folder:
        scan = seen.saved(Path(folder))
        for skip in (True, False):
            reconstruct(scan, skip=skip)
    return time.perf_counter() - started
