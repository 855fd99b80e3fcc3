"""Run an area; whatever it throws is a row that does not hold, and the others go on."""

from __future__ import annotations

import importlib
import math
import time
import traceback
from typing import Any

from _stress.row import Progress, Row, Size


def run(area: str, size: Size, progress: Progress) -> list[dict[str, Any]]:
    """Return the area's rows as plain data, each with the seconds it took."""
    rows: list[dict[str, Any]] = []
    began = time.perf_counter()

    def add(row: Row) -> None:
        nonlocal began
        now = time.perf_counter()
        rows.append(row.plain() | {"seconds": now - began})
        began = now

    try:
        for row in importlib.import_module(f"_stress.{area}_area").rows(size, progress):
            add(row)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{place.filename.rpartition('/')[2]}:{place.lineno}"
        what = " ".join(f"{type(error).__name__}: {error}".split())
        add(Row(f"{area}: ended early", "", math.nan, 0.0, "faults", note=f"{what} ({where})"))
    return rows
