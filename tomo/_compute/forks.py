"""Processes that were forked after OpenMP had started its threads: they have none of them.

GNU's OpenMP cannot go on there. numba ends such a process at its first parallel loop, by a signal,
and `multiprocessing.Pool` then starts another one, for ever. An error says what to do instead.
"""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable
from importlib import import_module

import numba

_threads_lost = threading.Event()
"""Set for good in a forked process, where it holds; a process that is spawned begins afresh."""


def _look_for_threads() -> None:
    try:
        layer = numba.threading_layer()
    except ValueError:  # no parallel loop has run
        return
    if layer == "omp" and import_module("numba.np.ufunc.omppool").openmp_vendor == "GNU":
        _threads_lost.set()  # other vendors' OpenMP, and other layers, start new threads


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_look_for_threads)


def refused_without_threads(kernel: Callable) -> Callable:
    """Return a parallel kernel that raises `RuntimeError` where it would end the process."""

    @functools.wraps(kernel, updated=())
    def entered(*arguments: object) -> object:
        if _threads_lost.is_set():
            raise RuntimeError(
                "parallel loops: found a process that was forked after their threads had started, "
                "expected one that is spawned: multiprocessing.get_context('spawn')"
            )
        return kernel(*arguments)

    return entered
