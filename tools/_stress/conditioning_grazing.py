"""Rays that meet next to nothing of the voxels there are: their noise may not become a flame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from _stress.row import Row, worst_of
from _stress.values_scene import ring, run, simulated_by
from tomo import LinearSystem, solvers
from tomo.hull import carve

NOISE = 0.1
VIEWS = 5
ITERATIONS = 10
SCENES = 8
SUBSETS = 8

CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    *((method, {}) for method in solvers.METHODS),
    ("sirt", {"subsets": SUBSETS}),
    ("mlem", {"subsets": SUBSETS}),
)


def grazing_rows(quick: bool) -> Iterator[Row]:
    """Yield the row of rays that graze what carving left."""
    grazing, figures = [], []
    for seed in range(1, 3 if quick else SCENES + 1):
        seen = simulated_by(ring(VIEWS), flame=("jet", seed), noise=NOISE, seed=seed)
        images = list(seen.images.values())
        carving = carve(tuple(seen.rig), images, None, seen.grid)
        system = LinearSystem.from_rig(
            seen.rig, seen.grid, masks=carving.pixels, active=carving.active, form="stored"
        )
        measured, rows = system.flatten(images), system.projector.row_sums
        grazing.append(rows[rows > 0].min() / np.median(rows))
        for method, settings in CASES:
            name = ", ".join([f"{method}, jet {seed}", *(f"{k} {v}" for k, v in settings.items())])
            found = run(method, system.projector, measured, ITERATIONS, **settings)
            figures.append((name, found.volume.max() / seen.truth.max()))
    worst, where = worst_of(figures)
    yield Row(
        "rays that graze what carving left: brightest voxel, every classic method",
        f"{len(grazing)} scenes of {VIEWS} views, {NOISE:.0%} noise, all pixels and subsets; the "
        f"shortest ray {min(grazing):.0e} of the median one",
        worst,
        5.0,
        "times the truth's",
        note=where,
    )
