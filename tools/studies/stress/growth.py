"""Time and memory of the default as voxels, views and pixels grow: log-log fits.

Each point is a process of its own that reconstructs one scan: seconds of the processor, and the
memory taken at the peak beyond what imports, a small reconstruction and the images had taken. The
slope is the power that a straight line through the logarithms gives, with its standard error.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import psutil
from scipy.stats import linregress

from studies.common.scans import reconstructed, simulated_by
from studies.common.study import Request, Tables
from studies.common.timing import forget_the_peak, in_fresh_process, peak_resident
from studies.stress.row import Row
from studies.stress.scene import jet_by, ring
from tomo import VoxelGrid, load_scan

BOX = (10.0, 20.0, 10.0)
START = {"edge": 20, "views": 12, "width": 48}
"""Voxels along the box's shorter edges, views, and pixels across an image twice as high."""

GROWING = {
    "voxels": ("edge", (20, 26, 32, 40, 50)),
    "views": ("views", (6, 9, 12, 18, 27, 40)),
    "pixels": ("width", (34, 48, 68, 96, 136)),
}
STEEPEST = 1.2  # power of voxels, views or pixels: each solve is linear in them or less


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    every = 1 if request.size == "full" else 2
    for along, (key, values) in GROWING.items():
        points = []
        for value in request.each(values[::every], f"{along}: {key} {{}}".format):
            points.append({"along": along} | point(**(START | {key: value}), seed=request.seed))
        for what in ("cpu_seconds", "peak_mb"):
            yield growth_row(what, along, points, what == "cpu_seconds")


@cache
def point(edge: int, views: int, width: int, seed: int) -> dict[str, Any]:
    """Simulate a scan and reconstruct it in a process of its own."""
    grid = VoxelGrid((edge, 2 * edge, edge), BOX[0] / edge)
    rig = ring(views, image_size=(width, 2 * width), footprint=1.2 * BOX[0] / width)
    with tempfile.TemporaryDirectory() as folder:
        simulated_by(rig, grid, ("turbulent", seed), noise=0.02, seed=seed).save(folder)
        found = in_fresh_process("studies.stress.growth", folder)
    del found["wall_seconds"]
    return {"voxels": grid.size, "views": views, "pixels": 2 * width**2, **found}


def growth_row(what: str, along: str, points: list[dict[str, Any]], first: bool) -> Row:
    """Return the slope of a figure along what grows; the first row of some points keeps them."""
    amounts, figures = ([one[key] for one in points] for key in (along, what))
    found = linregress(np.log(amounts), np.log(figures))
    over = f"{min(amounts):,} to {max(amounts):,} {along}"
    fit = {"what": what, "along": along, "slope": found.slope, "uncertainty": found.stderr,
           "least": figures[0], "most": figures[-1]}  # fmt: skip
    lines = {"fits": [fit]} | ({"growth": points} if first else {})
    return Row(f"{what.replace('_', ' ')} of the default with {along}: power", over, found.slope,
               STEEPEST, f"± {found.stderr:.2f}", lines=lines)  # fmt: skip


def _panels(tables: Tables) -> tuple[dict[str, dict[str, list]], str, str]:
    panels: dict[str, dict[str, list]] = {}
    smallest: dict[str, float] = {}
    for row in tables["growth"]:
        along = row["along"]
        amount = row[along] / smallest.setdefault(along, row[along])
        for key, words in (("cpu_seconds", "seconds of a core"), ("peak_mb", "peak memory (MB)")):
            panels.setdefault(words, {}).setdefault(along, []).append((amount, row[key]))
    return panels, "times the smallest", ""


PLOTS = {"growth": _panels}


def _reconstruct(folder: str) -> dict[str, float]:
    """Return the seconds and the megabytes of a scan's default."""
    reconstructed(jet_by(ring(5), noise=0.02))  # compiled code is loaded
    scan = load_scan(folder)
    forget_the_peak()
    before = psutil.Process().memory_info().rss
    started, worked = time.perf_counter(), time.process_time()
    reconstructed(scan)
    return {
        "cpu_seconds": time.process_time() - worked,
        "seconds": time.perf_counter() - started,
        "peak_mb": (peak_resident() - before) / 1e6,
    }


if __name__ == "__main__":
    sys.stdout.write(json.dumps(_reconstruct(sys.argv[1])))
