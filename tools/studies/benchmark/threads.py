"""How time falls with threads, all products run in turn in one process; medians.

The row `reading` holds nothing of ours: a large array is read, which gains no more by further
threads than the machine has left of its way to memory.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numba
import numpy as np

from studies.benchmark.memory_child import cameras
from studies.benchmark.reading import LARGE, read
from studies.benchmark.scaling import FORMS, VIEWS
from studies.benchmark.sizes import SIZES
from studies.common.study import Request, Tables
from studies.common.timing import in_turn
from tomo import LinearSystem, VoxelGrid

COLUMNS = {"threads": "form product edge views threads seconds speed_up"}


def run(request: Request) -> Tables:
    """Return the median time of each product by number of threads."""
    sizes = SIZES[request.size]
    edge = sizes.views_edge
    grid = VoxelGrid((edge, edge, edge), 1.0)
    rig = cameras(VIEWS, edge, grid)
    most = numba.config.NUMBA_NUM_THREADS
    counts = sorted({1, most, *(2**n for n in range(1, 10) if 2**n < most)})
    work: dict[tuple[str, str], Callable[[], object]] = {}
    for form in FORMS:
        projector = LinearSystem.from_rig(rig, grid, form=form).projector
        volume = np.ones(projector.shape[1], np.float32)
        work[form, "forward"] = partial(projector.__matmul__, volume)
        work[form, "adjoint"] = partial(projector.T.__matmul__, projector @ volume)
    work["the machine", "reading"] = partial(read, np.ones(LARGE, np.float32))
    started_with = numba.get_num_threads()
    try:
        seconds = in_turn(
            {
                (*names, count): partial(_on_threads, count, product)
                for names, product in work.items()
                for count in counts
            },
            sizes.repeats,
        )
    finally:
        numba.set_num_threads(started_with)
    return {
        "threads": [
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
    }


def _on_threads(count: int, product: Callable[[], object]) -> object:
    numba.set_num_threads(count)
    return product()
