"""Trace and project once in a process of its own; print times and peak memory as JSON.

Run by `studies.benchmark.scaling`: how much memory a process ever took cannot be asked for a
part of it.
"""

from __future__ import annotations

import json
import resource
import statistics
import sys
import time
from pathlib import Path

import numba
import numpy as np
import psutil

from rigs import Rig, ring
from tomo import LinearSystem, VoxelGrid, solvers

HIGH_WATER = Path("/proc/self/status")


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


def cameras(views: int, pixels: int, grid: VoxelGrid) -> Rig:
    """Return ``views`` square cameras, pitched in turn, whose images the grid just about fills."""
    widest = float(np.linalg.norm(grid.extent))
    return ring(
        views,
        distance=20 * widest,
        image_size=(pixels, pixels),
        footprint=0.75 * widest / pixels,
        pitch_degrees=np.where(np.arange(views) % 2 == 0, 15.0, -15.0),
    )


def measure(edge: int, views: int, pixels: int, form: str, repeats: int, solver: str = "") -> dict:
    """Return seconds and bytes of tracing and of products; ``solver`` also runs one iteration."""
    grid = VoxelGrid((edge, edge, edge), 1.0)
    rig = cameras(views, pixels, grid)
    forget_the_peak()
    before = psutil.Process().memory_info().rss
    started = time.perf_counter()
    projector = LinearSystem.from_rig(rig, grid, form=form).projector
    traced = time.perf_counter()
    found = {"trace_seconds": traced - started, "trace_bytes": peak_resident() - before}
    volume = np.ones(projector.shape[1], np.float32)
    images = projector @ volume
    forward = time.perf_counter()
    projector.T @ images
    found |= {
        "first_forward_seconds": forward - traced,
        "first_adjoint_seconds": time.perf_counter() - forward,
        "peak_bytes": peak_resident() - before,
    }
    if solver:
        getattr(solvers, solver)(projector, images, iterations=1)
        found["solver_bytes"] = peak_resident() - before
    times: dict[str, list[float]] = {"forward": [], "adjoint": []}
    for _ in range(repeats):
        for name, product in (("forward", projector), ("adjoint", projector.T)):
            operand = volume if name == "forward" else images
            started = time.perf_counter()
            product @ operand
            times[name].append(time.perf_counter() - started)
    return found | {
        "forward_seconds": statistics.median(times["forward"]),
        "adjoint_seconds": statistics.median(times["adjoint"]),
        "rows": projector.shape[0],
        "segments": projector.n_segments,
        "voxels": grid.size,
        "threads": numba.get_num_threads(),
        "needed_bytes": 4 * (views * pixels**2 + 2 * grid.size),
    }


if __name__ == "__main__":
    asked = json.loads(sys.argv[1])
    measure(8, 2, 8, asked["form"], 1, asked.get("solver", ""))  # imports and compiled kernels
    sys.stdout.write(json.dumps(measure(**asked)))
