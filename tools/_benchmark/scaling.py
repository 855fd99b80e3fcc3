"""How time and memory grow: with the grid, with views, and time with threads."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from _benchmark import cores
from _benchmark.children import in_fresh_process
from _benchmark.memory_child import cameras
from _benchmark.sizes import Sizes
from _benchmark.solvers import Progress, Rows
from _benchmark.timing import in_turn
from tomo import LinearSystem, VoxelGrid
from tomo._compute.memory import available_memory
from tomo.operators import STORED, estimate_memory

FORMS = ("on-the-fly", "stored")
MACHINE = "the machine"

VIEWS = 12
"""How many there are as the grid grows."""

SHARE = 0.6
"""Of the free memory, that a case may be estimated to take."""


def scaling(sizes: Sizes, progress: Progress) -> Rows:
    """Return ``scaling_edge``, ``scaling_views``, ``threads`` and ``memory_target``.

    Images have as many pixels along their edge as the grid has voxels. Every row of the first two
    is a process of its own; ``peak_bytes`` is what it took beyond what it had after its imports
    and a tiny problem.
    """
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
    total = len(by_edge) + len(by_views) + 2
    done = 0

    def measured(asked: dict[str, Any]) -> dict[str, Any]:
        nonlocal done
        progress(done, total, f"{asked['edge']}^3, {asked['views']} views, {asked['form']}")
        done += 1
        reason = _too_large(asked)
        if reason:
            return {**asked, "skipped": reason}
        repeats = min(sizes.repeats, 3)
        return asked | in_fresh_process(
            "memory_child.py", json.dumps(asked | {"repeats": repeats})
        )

    rows = {
        "scaling_edge": [measured(asked) for asked in by_edge],
        "scaling_views": [measured(asked) for asked in by_views],
        "memory_target": [measured(target)],
    }
    progress(done, total, "threads")
    rows["threads"] = threads(sizes)
    progress(total, total, "")
    return rows


def threads(sizes: Sizes) -> list[dict[str, Any]]:
    """Return the median times of the products by number of threads, all of them run in turn.

    Beside them the form `MACHINE`, which has nothing of ours: what threads gain there is what the
    machine has to give.
    """
    edge = sizes.views_edge
    grid = VoxelGrid((edge, edge, edge), 1.0)
    rig = cameras(VIEWS, edge, grid)
    most = numba.config.NUMBA_NUM_THREADS
    counts = sorted({1, most, *(2**n for n in range(1, 10) if 2**n < most)})
    products: dict[tuple[str, str, int], Callable[[], object]] = {}
    for form in FORMS:
        projector = LinearSystem.from_rig(rig, grid, form=form).projector
        volume = np.ones(projector.shape[1], np.float32)
        images = projector @ volume
        for count in counts:
            products[form, "forward", count] = _with_threads(count, projector.__matmul__, volume)
            products[form, "adjoint", count] = _with_threads(count, projector.T.__matmul__, images)
    limits = {
        "arithmetic": (cores.arithmetic,),
        "waiting": (cores.waiting,),
        "reading": (cores.reading, np.ones(cores.LARGE, np.float32)),
    }
    for name, work in limits.items():
        for count in counts:
            products[MACHINE, name, count] = _with_threads(count, *work)
    started_with = numba.get_num_threads()
    try:
        seconds = in_turn(products, sizes.repeats)
    finally:
        numba.set_num_threads(started_with)
    return [
        {
            "form": form,
            "product": product,
            "edge": edge,
            "views": VIEWS,
            "threads": count,
            "seconds": taken,
            "speed_up": seconds[form, product, 1] / taken,
        }
        for (form, product, count), taken in seconds.items()
    ]


def _with_threads(count: int, work: Callable, *operands: np.ndarray) -> Callable[[], object]:
    def run() -> object:
        numba.set_num_threads(count)
        return work(*operands)

    return run


def _too_large(asked: dict[str, Any]) -> str:
    """Return why a case is left out, or nothing."""
    grid = VoxelGrid((asked["edge"],) * 3, 1.0)
    rig = cameras(asked["views"], asked["pixels"], grid)
    need = estimate_memory(tuple(rig), grid, form=STORED if asked["form"] == STORED else FORMS[0])
    free = available_memory()
    if need.nbytes <= SHARE * free:
        return ""
    return f"would take about {need.nbytes / 1e9:.1f} GB of {free / 1e9:.1f} GB free"
