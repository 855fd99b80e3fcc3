"""How much memory there is, and how much was used."""

from __future__ import annotations

import os
import sys

import psutil

from tomo._compute.control_groups import left_in_groups

LIBRARIES_TAKE, A_THREAD_TAKES = 2_000_000_000, 75_000_000
"""Bytes of address space, most of it never touched: code, and stacks and heaps of threads."""


def available_memory() -> int:
    """Return the bytes that this process may still take.

    What the system has free, or less where a container, a batch system or ``ulimit -v`` allows
    less.
    """
    limits = [psutil.virtual_memory().available, left_in_groups(), _left_of_address_space()]
    return max(min(limit for limit in limits if limit is not None), 0)


def check_address_space() -> None:
    """Raise where ``ulimit -v`` allows less than the libraries take.

    Loaded nevertheless, some crash with no word when they cannot have it.

    Raises
    ------
    ValueError
        Saying how much there is, and how much is needed.
    """
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
