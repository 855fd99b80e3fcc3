"""Too few views, cameras at one place, too many iterations, and discs that are not there."""

from __future__ import annotations

from studies.common.study import Request, Tables
from studies.stress.focus import focus_rows
from studies.stress.row import COLUMNS, charts, measured
from studies.stress.stops import stop_rows
from studies.stress.weak_rigs import rig_rows

__all__ = ["COLUMNS", "PLOTS", "run"]

PLOTS = {"conditioning": charts}


def run(request: Request) -> Tables:
    """Measure all three."""
    quick = request.size != "full"
    parts = {"rigs": rig_rows, "stops": stop_rows, "focus": focus_rows}
    rows = []
    for number, (name, part) in enumerate(parts.items()):
        request.progress(number, len(parts), name)
        rows += measured(part(quick))["rows"]
    return {"rows": rows}
