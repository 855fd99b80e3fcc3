"""A study's results as plain data: the machine, and an earlier run to go on from."""

from __future__ import annotations

import json
import os
import platform
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
import psutil

from studies.common.fingerprint import origin
from tomo.pipeline.report_json import versions

if TYPE_CHECKING:
    from studies.common.study import Request


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


def fresh_run(study: str, version: int, request: Request) -> dict[str, Any]:
    """Return the result of no part yet."""
    return {
        "study": study,
        "version": version,
        "size": request.size,
        "seed": request.seed,
        "machine": machine(),
        **origin(),
        "parts": {},
    }


def kept_run(path: Path, fresh: dict[str, Any]) -> dict[str, Any]:
    """Return what an earlier run left, to go on from it; ``fresh`` where there is nothing.

    That of another study, size, seed or machine is refused.
    """
    if not path.is_file():
        return fresh
    try:
        result = json.loads(path.read_text("utf-8"))
        known = all(result[key] == fresh[key] for key in ("study", "version"))
        known = known and isinstance(result["parts"], dict)
        settings = {key: (result[key], fresh[key]) for key in ("size", "seed")}
        for key in ("cpu", "cores"):
            settings[key] = result["machine"][key], fresh["machine"][key]
    except (ValueError, KeyError, TypeError):
        known = False
    if not known:
        raise ValueError(f"{path}: expected the result of an earlier {fresh['study']} run")
    for key, (found, expected) in settings.items():
        if found != expected:
            raise ValueError(f"{path}: --resume: {key}: found {found!r}, expected {expected!r}")
    return result
