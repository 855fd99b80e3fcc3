"""The machine: threads, memory, disks, folders, kills, interruptions, and two runs at once."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from _stress import machine_kills, machine_limits
from _stress.machine_commands import small_scan
from _stress.machine_results import reconstructions, simulations
from _stress.row import Progress, Row, Size


def rows(size: Size, progress: Progress) -> Iterator[Row]:
    """Yield the rows of the area as they are measured; on POSIX systems alone."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scan = small_scan(folder / "scan")
        if not size.quick:  # the area of threads has them too
            progress(0, 1, "threads")
            yield from machine_limits.threads(scan, folder)
        progress(0, 1, "memory")
        yield from machine_limits.memory(scan, folder, size)
        progress(0, 1, "disk")
        yield from machine_limits.disk(scan, folder, size)
        yield from machine_limits.read_only(scan, folder)
        yield from machine_kills.writers(folder, size, progress)
        yield machine_kills.training(scan, folder, size, progress)
        progress(0, 1, "two runs")
        results = simulations(scan, folder / "whole") if size.quick else reconstructions(scan)
        row, seconds = machine_kills.two_runs(results, folder, size)
        yield row
        yield from machine_kills.signals(results, folder / "two-0", seconds, size, progress)
