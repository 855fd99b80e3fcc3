"""One place that decides how kernels are compiled, threaded and cached.

numba's TBB layer refuses the TBB of many systems with a warning and its ``workqueue`` layer must
not be entered from two threads, so OpenMP comes first. Compiled code is cached beside the package
or, where that folder is read-only, in the user's cache; without either it is compiled afresh.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core.cpu import ParallelOptions

from tomo._compute.wait_policy import set_passive_waiting

set_passive_waiting()
numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]

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

    Parameters
    ----------
    parallel : bool
        Whether ``numba.prange`` loops run on all cores. Every kernel of the project gives each
        output element to one iteration, so that results do not depend on the number of threads.
    inline : bool
        For small helpers called from inner loops; only compiled code can call them. What calls
        them is cached with them in it.
    reassociate : bool
        Whether sums may be taken in another order, so that a loop over one vectorises; NaN and
        infinity keep their meaning. The order is fixed by the compiled code, not by the threads.
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
            return numba.njit(function, **options)
        if not inline:
            _cached_with_helpers(kernel)
        return kernel

    return decorate


def _cached_with_helpers(kernel: numba.core.dispatcher.Dispatcher) -> None:
    """Have what is cached of a kernel not outlive a change of what it calls.

    numba looks at the kernel's own file only: after an upgrade that changes a helper elsewhere,
    the kernel of before would be loaded for ever.
    """
    file = getattr(kernel._cache, "_cache_file", None)  # numba has no public way
    if file is not None:
        file._source_stamp = f"{file._source_stamp} {helpers_stamp(kernel.py_func)}"


def helpers_stamp(function: Callable) -> str:
    """Return what changes with the helpers and constants that a kernel takes from its globals.

    Helpers, and theirs, count with the files that they stand in; constants with their values.
    """
    waiting, found = [function], {function}
    parts = set()
    while waiting:
        some = waiting.pop()
        for name in some.__code__.co_names:
            value = some.__globals__.get(name)
            helper = getattr(value, "py_func", getattr(value, "_defn", None))
            if isinstance(value, (bool, int, float)):
                parts.add(f"{name} = {value!r}")
            elif helper is not None and helper not in found:
                found.add(helper)
                waiting.append(helper)
    for file in {Path(one.__code__.co_filename) for one in found}:
        if file.is_file():
            parts.add(hashlib.sha256(file.read_bytes()).hexdigest())
    return hashlib.sha256("\n".join(sorted(parts)).encode()).hexdigest()
