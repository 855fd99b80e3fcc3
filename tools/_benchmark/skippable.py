"""How much of a scene could be left out by whoever knew the flame itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from _benchmark.scenes import Scene, scene
from _benchmark.sizes import Sizes
from _benchmark.skipping import SEED
from _benchmark.solvers import Progress
from tomo import LinearSystem, metrics
from tomo.grid import ActiveVoxels

FAINTEST = (0.0, 0.001, 0.005, 0.02)
"""Shares of the brightest voxel up to which the others are left out."""


def skippable(sizes: Sizes, progress: Progress) -> list[dict[str, Any]]:
    """Return a row for each flame and each share of the brightest voxel.

    Left out is every voxel of the truth that is no brighter: what no image tells as well.
    """
    rows = []
    for number, flame in enumerate(sizes.flames):
        progress(number, len(sizes.flames), f"{flame}, what the truth would let be left out")
        seen = scene(flame, 33, "clean", SEED, sizes, sizes.skip_shrink)
        rows += _rows(seen)
    progress(len(sizes.flames), len(sizes.flames), "")
    return rows


def _rows(seen: Scene) -> list[dict[str, Any]]:
    scan, rows = seen.scan, []
    every = LinearSystem.from_rig(scan.rig, scan.grid, skip=False, form="on-the-fly")
    everything = every.projector.n_segments
    for share in FAINTEST:
        bright = scan.truth > share * scan.truth.max()
        active = ActiveVoxels.from_mask(scan.grid, bright)
        system = LinearSystem.from_rig(scan.rig, scan.grid, active=active, form="stored")
        rows.append(
            {
                "flame": seen.flame,
                "share": share,
                "active_voxels": active.size,
                "voxels": scan.grid.size,
                "segments": system.projector.n_segments,
                "fewer": everything / system.projector.n_segments,
                "cosine_distance": metrics.cosine_distance(
                    np.where(bright, scan.truth, np.float32(0)), scan.truth
                ),
            }
        )
    return rows
