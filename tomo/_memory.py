"""How much memory there is, and how much was used."""

from __future__ import annotations

import sys
from pathlib import Path

import psutil

_CGROUP = Path("/sys/fs/cgroup")


def available_memory() -> int:
    """Return the bytes that this process may still take.

    What the system has free, or less where a container, a batch system or ``ulimit -v`` allows
    less.
    """
    limits = [psutil.virtual_memory().available, _left_in_container(), _left_of_address_space()]
    return max(min(limit for limit in limits if limit is not None), 0)


def peak_memory() -> int:
    """Return the process's largest resident memory so far in bytes; 0 where it is not known."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest if sys.platform == "darwin" else largest * 1024


def _left_in_container(cgroup: Path = _CGROUP) -> int | None:
    """Return what a control group (version 2) leaves; None where it sets no limit."""
    try:
        limit = (cgroup / "memory.max").read_text("ascii").strip()
        used = int((cgroup / "memory.current").read_text("ascii"))
        return None if limit == "max" else int(limit) - used
    except (OSError, ValueError):
        return None


def _left_of_address_space() -> int | None:
    """Return what ``ulimit -v`` leaves; None where there is no limit."""
    try:
        import resource
    except ImportError:
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit - psutil.Process().memory_info().vms
