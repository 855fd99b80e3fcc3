"""Conditioning: too few views, too many unknowns, too many iterations, too few digits."""

from __future__ import annotations

from collections.abc import Iterator

from _stress.conditioning_focus import focus_rows
from _stress.conditioning_grazing import grazing_rows
from _stress.conditioning_long import long_rows
from _stress.conditioning_rigs import rig_rows
from _stress.conditioning_stops import stop_rows
from _stress.conditioning_twins import twin_rows
from _stress.row import Progress, Row, Size


def rows(size: Size, progress: Progress) -> Iterator[Row]:
    """Yield the rows of the area."""
    parts = (
        ("rigs", rig_rows(size.quick)),
        ("stops", stop_rows(size.quick)),
        ("grazing rays", grazing_rows(size.quick)),
        ("out of focus", focus_rows(size.quick)),
        ("double precision", twin_rows()),
        ("long runs", long_rows(size.quick)),
    )
    for number, (name, part) in enumerate(parts):
        progress(number, len(parts), f"conditioning: {name}")
        yield from part
    progress(len(parts), len(parts), "")
