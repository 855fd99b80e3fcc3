"""Before anything is read: whether the cameras can be right, by the check of rigs."""

from __future__ import annotations

from rigs.check import convention_errors_in
from tomo.grid import VoxelGrid
from tomo.pipeline.options import Options
from tomo.scan import Scan


def check_cameras(scan: Scan, grid: VoxelGrid, options: Options) -> list[str]:
    """Return lines on errors of unit and convention, as ``check-rig`` finds them.

    Raises
    ------
    ValueError
        If all cameras have one, or one stands inside the grid, and `Options.screen` is on: no
        volume comes of it.
    """
    lines = []
    for error in convention_errors_in(scan.rig, grid):
        everyone = set(error.cameras) >= set(scan.rig.names)
        who = "all cameras" if everyone else f"camera {', '.join(error.cameras)}"
        line = (
            f"{who}: {error.text}. Correct the rig or the grid; flametomo check-rig shows what "
            "the cameras see"
        )
        if everyone and options.screen:
            raise ValueError(f"{scan.where}{line}. screen=False reconstructs all the same")
        lines.append(line)
    for camera in scan.rig if options.screen else ():
        if ((camera.position > grid.lower) & (camera.position < grid.upper)).all():
            why = "".join(
                f"; {line}" for line in lines if line.startswith(f"camera {camera.name}:")
            )
            raise ValueError(
                f"{scan.where}camera {camera.name}: found its position inside the grid, expected "
                f"it outside: correct the rig, or take a smaller grid{why}. screen=False "
                "reconstructs all the same"
            )
    return lines
