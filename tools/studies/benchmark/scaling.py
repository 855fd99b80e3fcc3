"""How time and memory grow with the grid and with views.

Images have as many pixels along their edge as the grid has voxels. Each row is a process of its
own; memory is what it took at its peak beyond what it had after imports and a tiny problem. The
images and two volumes ("needed") are what a product and its adjoint hold in any case; the memory
target also runs one step of SIRT.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
import psutil

from rigs import Rig, ring
from studies.benchmark.sizes import SIZES
from studies.common.study import Request, Tables
from studies.common.timing import forget_the_peak, in_fresh_process, in_turn, peak_resident
from tomo import LinearSystem, VoxelGrid, solvers
from tomo.operators import STORED, estimate_memory


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
    found = {"trace_seconds": time.perf_counter() - started}
    found["trace_bytes"] = peak_resident() - before
    volume = np.ones(projector.shape[1], np.float32)
    images = projector @ volume
    projector.T @ images
    found["peak_bytes"] = peak_resident() - before
    if solver:
        getattr(solvers, solver)(projector, images, iterations=1)
        found["solver_bytes"] = peak_resident() - before
    products = {"forward": lambda: projector @ volume, "adjoint": lambda: projector.T @ images}
    found |= {f"{name}_seconds": s for name, s in in_turn(products, repeats).items()}
    found["needed_bytes"] = 4 * (views * pixels**2 + 2 * grid.size)
    return found | {"segments": projector.n_segments}


FORMS = ("on-the-fly", "stored")
VIEWS = 12  # how many there are as the grid grows
SHARE = 0.6
"""Fraction of the free memory that a case may take by estimate; larger ones are left out."""


def run(request: Request) -> Tables:
    """Return ``with_the_grid``, ``with_views`` and ``memory_target``."""
    sizes = SIZES[request.size]
    by_edge = [
        {"edge": edge, "views": VIEWS, "pixels": edge, "form": form}
        for form, edges in zip(FORMS, (sizes.edges, sizes.stored_edges), strict=True)
        for edge in edges
    ]
    by_views = [
        {"edge": sizes.views_edge, "views": views, "pixels": sizes.views_edge, "form": form}
        for form in FORMS
        for views in sizes.views
    ]
    edge, views, pixels = sizes.large
    target = {"edge": edge, "views": views, "pixels": pixels, "form": FORMS[0], "solver": "sirt"}
    asked = {"with_the_grid": by_edge, "with_views": by_views, "memory_target": [target]}
    tables: Tables = {table: [] for table in asked}
    jobs = [(table, case) for table, cases in asked.items() for case in cases]
    for table, case in request.each(jobs, "{0[1][edge]}^3, {0[1][views]} views".format):
        if not _too_large(case):
            tables[table].append(_measured(case, min(sizes.repeats, 3)))
    return tables


def _measured(case: dict[str, Any], repeats: int) -> dict[str, Any]:
    asked = json.dumps(case | {"repeats": repeats})
    row = case | in_fresh_process("studies.benchmark.scaling", asked)
    row["over_needed"] = row["peak_bytes"] / row["needed_bytes"]
    if "solver_bytes" in row:
        row["solver_over_needed"] = row["solver_bytes"] / row["needed_bytes"]
    return row


def _too_large(case: dict[str, Any]) -> bool:
    grid = VoxelGrid((case["edge"],) * 3, 1.0)
    rig = cameras(case["views"], case["pixels"], grid)
    need = estimate_memory(tuple(rig), grid, form=STORED if case["form"] == STORED else FORMS[0])
    return need.nbytes > SHARE * psutil.virtual_memory().available


def _panels(tables: Tables) -> tuple[dict[str, dict[str, list]], str, str]:
    """Return seconds, and peak memory, against the grid's edge."""
    times: dict[str, list] = {}
    memory: dict[str, list] = {}
    for row in tables["with_the_grid"]:
        for key in ("trace", "forward", "adjoint"):
            point = row["edge"], row[f"{key}_seconds"]
            times.setdefault(f"{row['form']}: {key}", []).append(point)
        memory.setdefault(f"{row['form']}: peak", []).append(
            (row["edge"], row["peak_bytes"] / 1e6)
        )
        needed = row["edge"], row["needed_bytes"] / 1e6
        memory.setdefault("images + 2 volumes", []).append(needed)
    return {"seconds": times, "memory (MB)": memory}, "edge", ""


PLOTS = {"scaling_edge": _panels}


if __name__ == "__main__":
    asked = json.loads(sys.argv[1])
    measure(8, 2, 8, asked["form"], 1, asked.get("solver", ""))  # imports and compiled kernels
    sys.stdout.write(json.dumps(measure(**asked)))
