"""The page's pictures: convergence of each part's trainings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.common.axes import curves
from studies.paper.rows import ROWS
from tomo.draw.figures import save_figure


def picture_of(part: str) -> str:
    """Return where a part's picture is in the output folder."""
    return f"paper/{part}_convergence.png"


def draw_convergence(part: str, rows: Mapping[str, Mapping[str, Any]], out: Path) -> None:
    """Draw the cosine distance of a part's trainings against the epoch, a panel for each flame."""
    panels: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for name, row in rows.items():
        if ROWS[name].part == part and not row["art"]:
            points = [(epoch, distance) for epoch, distance, _ in row["curve"]]
            panels.setdefault(row["flame"], {})[name] = points
    if panels:
        save_figure(curves(panels, "epoch", "cosine distance"), out / picture_of(part))
