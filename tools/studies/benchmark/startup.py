"""What starting and first use cost: with nothing compiled yet, and with compiled code on disk.

Seconds of whole fresh processes; "warm" ones are medians, with an empty cache of compiled code
each runs once. `kernels` traces and projects in both forms and runs one iteration of every
solver, `reconstruct` is the default on a tiny scan.
"""

from __future__ import annotations

import inspect
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from studies.benchmark.sizes import SIZES
from studies.common.flames import scene
from studies.common.study import Request, Tables
from studies.common.timing import LIMIT, TOOLS

CACHE = "NUMBA_CACHE_DIR"


def kernels() -> None:
    """Trace and project in both forms, and run one iteration of every solver."""
    import numpy as np

    from rigs import ring
    from tomo import LinearSystem, VoxelGrid, solvers

    grid = VoxelGrid((6, 8, 6), 1.0)
    rig = ring(4, distance=100.0, image_size=(8, 8), footprint=1.2)
    for form in ("on-the-fly", "stored"):
        projector = LinearSystem.from_rig(rig, grid, form=form).projector
        for dtype in (np.float32, np.float64):
            projector.T @ (projector @ np.ones(grid.size, dtype))
    measured = projector @ np.ones(grid.size, np.float32)
    for method in solvers.METHODS:
        getattr(solvers, method)(projector, measured, iterations=1)


CODE = {
    "python": "",
    "import tomo": "import tomo",
    "kernels": f"{inspect.getsource(kernels)}\nkernels()",
    "reconstruct": "import sys, tomo; tomo.reconstruct(tomo.load_scan(sys.argv[1]))",
}
"""What each process does; the scan's folder is its argument."""


def run(request: Request) -> Tables:
    """Return the seconds of each process with an empty and with a warm cache of compiled code."""
    sizes = SIZES[request.size]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        scan = Path(folder) / "scan"
        scene("jet", 11, "clean", 0, SIZES["tiny"].flame).scan.save(scan)
        for what in request.each(CODE, str):
            afresh = what in sizes.afresh
            own = {CACHE: str(Path(folder) / what)} if afresh else {}
            empty = _seconds(what, scan, own) if afresh else None
            warm = statistics.median(_seconds(what, scan, own) for _ in range(sizes.starts))
            rows.append({"what": what, "empty": empty, "warm": warm})
    return {"startup": rows}


def _seconds(what: str, scan: Path, environment: dict[str, str]) -> float:
    paths = os.pathsep.join(filter(None, (str(TOOLS.parent), os.environ.get("PYTHONPATH"))))
    started = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", CODE[what], str(scan)],
        env=os.environ | {"PYTHONPATH": paths} | environment,
        timeout=LIMIT,
        check=True,
    )
    return time.perf_counter() - started
