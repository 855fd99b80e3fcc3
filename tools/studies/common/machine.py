"""What the figures were measured on."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import Any

import numba
import psutil

from tomo.pipeline.report_json import versions


def machine() -> dict[str, Any]:
    """Return the processor, cores, memory, versions, and the load at this moment."""
    return {
        "cpu": _cpu_model(),
        "cores": len(psutil.Process().cpu_affinity() or [])
        if hasattr(psutil.Process, "cpu_affinity")
        else psutil.cpu_count(),
        "threads": numba.config.NUMBA_NUM_THREADS,
        "memory_gb": psutil.virtual_memory().total / 1e9,
        "system": platform.system(),
        "architecture": platform.machine(),
        "load_at_start": load(),
        "versions": versions(),
    }


def load() -> float | None:
    """Return how many processes wanted a core in the last minute; None where it is not known."""
    try:
        return os.getloadavg()[0]
    except (AttributeError, OSError):
        return None


def cpu_seconds() -> float:
    """Return the seconds that cores worked for this process and those that it waited for."""
    return sum(os.times()[:4])


def _cpu_model() -> str:
    """Return the processor's name; platform.processor is empty on Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if "model name" in line)
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
