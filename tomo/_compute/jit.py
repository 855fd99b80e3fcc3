"""How kernels are compiled, threaded and cached, and where they refuse to run.

numba's TBB layer refuses the TBB of many systems with a warning and its ``workqueue`` layer must
not be entered from two threads, so OpenMP comes first. Compiled code is cached beside the package
or, where that folder is read-only, in the user's cache; without either it is compiled afresh.

GNU's OpenMP cannot go on in a process that was forked after it had started its threads. numba ends
such a process at its first parallel loop, by a signal, and `multiprocessing.Pool` then starts
another one, for ever. An error says what to do instead.
"""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numba
from numba.core.cpu import ParallelOptions

from rigs.compiled import cached_with_helpers
from tomo._compute import set_passive_waiting

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


set_passive_waiting()
# An option that numba makes when it is loaded
numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]  # type: ignore[attr-defined]

_WHAT_NUMBA_FINDS = (
    "comprehension", "fusion", "inplace_binop", "numpy", "reduction", "setitem", "stencil",
)  # fmt: skip
_LOOPS_ALONE = ParallelOptions(dict.fromkeys(_WHAT_NUMBA_FINDS, False))
"""Only ``prange`` loops run in parallel: a search for others lengthens compilation in vain."""

_HOW: dict[str, Any] = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}


def compiled(
    *, parallel: bool = False, inline: bool = False, reassociate: bool = False
) -> Callable[[Callable], Callable]:
    """Return a decorator that compiles a kernel with IEEE arithmetic.

    ``parallel``: ``numba.prange`` loops run on all cores. Every kernel of the project gives each
    output element to one iteration, so that results do not depend on the number of threads.
    ``inline``: for small helpers called from inner loops; only compiled code can call them, and is
    cached with them in it. ``reassociate``: sums may be taken in another order, so that a loop
    over one vectorises; NaN and infinity keep their meaning. The order is that of the compiled
    code.
    """
    options = dict(_HOW)
    if parallel:
        options["parallel"] = _LOOPS_ALONE
    if inline:
        options |= {"forceinline": True, "no_cpython_wrapper": True}
    if reassociate:
        options["fastmath"] = {"reassoc", "nsz", "contract"}

    def decorate(function: Callable) -> Callable:
        try:
            kernel = numba.njit(function, cache=not inline, **options)
        except RuntimeError:  # no folder to cache in can be written
            kernel = numba.njit(function, **options)
        if not inline:
            cached_with_helpers(kernel)
        return refused_without_threads(kernel) if parallel else kernel

    return decorate
