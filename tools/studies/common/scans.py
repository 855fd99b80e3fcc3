"""Simulated scans, and the way back: through files, as a user would."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import phantoms
from rigs import Rig
from tomo import Scan, VoxelGrid, load_scan
from tomo.pipeline import Options, Reconstruction, reconstruct
from tomo.simulation import simulate
from tomo.simulation.simulate import SimulatedScan


def simulated_by(rig: Rig, grid: VoxelGrid, flame: tuple[str, int], **how: Any) -> SimulatedScan:
    """Return what a rig sees of a flame, given by its name and seed.

    Through voxels half as wide and with 2 x 2 rays a pixel, unless ``how`` says otherwise.
    """
    field = phantoms.create(*flame, grid.extent, grid.center)
    return simulate(rig, field, grid, **{"supersample": 2, "refine": 2} | how)


def reconstructed(
    scan: SimulatedScan | Scan, grid: VoxelGrid | None = None, **how: Any
) -> Reconstruction:
    """Return the reconstruction of a scan; a simulated one is written and read again."""
    if isinstance(scan, Scan):
        return reconstruct(scan, grid, Options(**how))
    with tempfile.TemporaryDirectory() as folder:
        return reconstruct(load_scan(scan.save(Path(folder) / "scan")), grid, Options(**how))


def seconds_of(outcome: Reconstruction) -> float:
    """Return the seconds from images in memory to the volume, without what is judged after."""
    others = sum(outcome.seconds[key] for key in ("load", "compare", "evaluate", "uncertainty"))
    return outcome.seconds["total"] - others
