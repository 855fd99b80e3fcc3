"""How much memory there is, and how much was used.

Containers, batch systems and services set limits by control groups. A process is in one group of
each hierarchy, which ``/proc/self/cgroup`` names, and every group above it limits it too. Version
2 has one hierarchy, version 1 one for memory alone. Source: ``Documentation/admin-
guide/cgroup-v2.rst`` and ``cgroup-v1/memory.rst`` of Linux.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import psutil

_ROOT, _OWN = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")

_FILES = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)
"""By version, two and one: the files of the limit and of the bytes in use, and the line of
``memory.stat`` that counts files kept in memory while nobody needs them."""

_NO_LIMIT = 2**60
"""Bytes from which a limit is none: version 1 writes the largest whole number of pages."""


def left_in_groups(root: Path = _ROOT, own: Path = _OWN) -> int | None:
    """Return the fewest bytes that a group of this process, or one above, leaves; None: no limit.

    ``root`` is the folder of the hierarchies, ``own`` the file that names the process's groups.
    """
    left = (_left_in(folder) for folder in _groups(root, own))
    return min((one for one in left if one is not None), default=None)


def _groups(root: Path, own: Path) -> Iterator[Path]:
    """Yield the folders of the groups that may limit the memory of this process."""
    try:
        lines = own.read_text("utf-8", "replace").splitlines()
    except OSError:
        lines = []
    paths = {"", "memory", "unified"}  # containers often show their own group in place of the root
    for line in lines:
        _, controllers, path = [*line.split(":", 2), "", ""][:3]
        if controllers and "memory" not in controllers.split(","):
            continue
        for mount in ("memory", controllers) if controllers else ("", "unified"):
            inside = PurePosixPath(mount, path.lstrip("/"))
            if ".." not in inside.parts:  # a group outside of what a container sees
                paths |= {str(one) for one in (inside, *inside.parents)}
    yield from (root / path for path in sorted(paths))


def _left_in(group: Path) -> int | None:
    """Return the bytes that one group leaves; None where it sets no limit."""
    for limit, used, kept in _FILES:
        try:
            most = (group / limit).read_text("ascii").strip()
            if most == "max" or int(most) >= _NO_LIMIT:
                continue
            taken = int((group / used).read_text("ascii"))
            return int(most) - taken + _given_back_on_demand(group, kept)
        except (OSError, ValueError):
            continue
    return None


def _given_back_on_demand(group: Path, line: str) -> int:
    """Return the bytes of files that a group keeps in memory while nobody needs it."""
    try:
        stated = (group / "memory.stat").read_text("ascii").splitlines()
        return next(int(one.split()[1]) for one in stated if one.startswith(f"{line} "))
    except (OSError, StopIteration):
        return 0


LIBRARIES_TAKE, A_THREAD_TAKES = 2_000_000_000, 75_000_000
"""Bytes of address space, most of it never touched: code, and stacks and heaps of threads."""


def available_memory() -> int:
    """Return the bytes that this process may still take: what is free, or what limits leave."""
    limits = [psutil.virtual_memory().available, left_in_groups(), _left_of_address_space()]
    return max(min(limit for limit in limits if limit is not None), 0)


def check_address_space() -> None:
    """Raise where ``ulimit -v`` allows less than libraries take: some would crash with no word."""
    limit = _address_space()
    needed = LIBRARIES_TAKE + A_THREAD_TAKES * _cores()
    if limit is not None and limit < needed:
        raise ValueError(
            f"memory: found an address space of {limit / 1e9:.1f} GB (ulimit -v), expected at "
            f"least {needed / 1e9:.1f} GB, which the libraries take before the first voxel"
        )


def peak_memory() -> int:
    """Return the process's largest resident memory so far in bytes; 0 where it is not known."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest if sys.platform == "darwin" else largest * 1024


def _left_of_address_space() -> int | None:
    """Return what ``ulimit -v`` leaves; None where there is no limit."""
    limit = _address_space()
    return None if limit is None else limit - psutil.Process().memory_info().vms


def _cores() -> int:
    """Return the cores that this process may use, and so the threads that libraries start."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on Linux
        return os.cpu_count() or 1


def _address_space() -> int | None:
    """Return the bytes that ``ulimit -v`` allows; None where there is no limit."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit
