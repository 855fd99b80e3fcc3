"""Use what is compiled for the first time in a process; print the seconds of each step as JSON.

Run by `studies.benchmark.startup`: ``kernels`` uses every kernel once, ``reconstruct SCAN`` the
default.
"""

from __future__ import annotations

import importlib
import json
import sys
import time

started = time.perf_counter()
import tomo  # noqa: E402

steps = {"import tomo": time.perf_counter() - started}


def timed(name: str, function, *arguments: object, **options: object) -> object:
    """Call a function and note the seconds it took."""
    before = time.perf_counter()
    result = function(*arguments, **options)
    steps[name] = steps.get(name, 0.0) + time.perf_counter() - before
    return result


def load_libraries() -> None:
    """Import what the packages load on first use."""
    for name in (
        "numba",
        "rigs.camera",
        "scipy.sparse",
        "tomo.operators.system",
        "tomo.pipeline.reconstruct",
    ):
        importlib.import_module(name)


def kernels() -> None:
    """Trace and project in both forms, and run one iteration of every solver."""
    timed("import libraries", load_libraries)
    import numpy as np

    from rigs import ring
    from tomo import LinearSystem, VoxelGrid, solvers

    grid = VoxelGrid((6, 8, 6), 1.0)
    rig = ring(4, distance=100.0, image_size=(8, 8), footprint=1.2)

    def products(form: str) -> LinearSystem:
        system = LinearSystem.from_rig(rig, grid, form=form)
        for dtype in (np.float32, np.float64):
            system.projector.T @ (system.projector @ np.ones(grid.size, dtype))
        return system

    timed("on the fly", products, "on-the-fly")
    system = timed("tracer and stored matrix", products, "stored")
    measured = system.projector @ np.ones(grid.size, np.float32)
    for method in solvers.METHODS:
        timed("solvers", getattr(solvers, method), system.projector, measured, iterations=1)


def reconstruct(path: str) -> None:
    """Load a scan and reconstruct it by the default method."""
    timed("import libraries", load_libraries)
    from tomo import load_scan
    from tomo.pipeline import reconstruct as run

    timed("reconstruct", run, load_scan(path))


if __name__ == "__main__":
    {"import": lambda: None, "kernels": kernels, "reconstruct": reconstruct}[sys.argv[1]](
        *sys.argv[2:]
    )
    sys.stdout.write(json.dumps({"steps": steps, "version": tomo.__name__}))
