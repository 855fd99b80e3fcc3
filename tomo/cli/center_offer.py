"""The centre of a grid that nobody gave: the point where the cameras' axes meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigs import Rig
    from rigs.check.result import RigCheck
    from tomo.grid import VoxelGrid


def offered_center(rig: Rig) -> str:
    """Return the centre to ask for, in words; nothing where the cameras' axes do not meet."""
    from rigs import point_in_view

    point = point_in_view(rig)
    return "" if point is None else f"; the cameras' axes meet at --center {_triple(point)}"


def with_offered_center(check: RigCheck, rig: Rig, grid: VoxelGrid) -> RigCheck:
    """Return the check with a line on the grid's centre, the origin as none was given."""
    import numpy as np

    from rigs import point_in_view
    from rigs.check.result import Finding

    point = point_in_view(rig)
    if point is None or np.abs(point - grid.center).max() < max(grid.spacing):
        return check
    is_outside = ((point < grid.lower) | (point > grid.upper)).any()
    finding = Finding(
        "warning" if is_outside else "note",
        "no --center was given and the rig has no volume, so the grid is about the origin; the "
        f"cameras' axes meet at {_triple(point)}: try --center {_triple(point)}",
        (),
    )
    return replace(check, findings=(finding, *check.findings))


def _triple(point: Sequence[float]) -> str:
    return ",".join(f"{value:.6g}" for value in point)
