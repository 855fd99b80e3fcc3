"""Compiling loops by numba, kept on disk where a folder can be written."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numba


def compiled(function: Callable) -> Callable:
    """Return the function compiled when it is first called; it releases the interpreter's lock."""
    try:
        kernel = numba.njit(function, cache=True, nogil=True, error_model="numpy")
    except RuntimeError:  # no folder to cache in can be written
        return numba.njit(function, nogil=True, error_model="numpy")
    cached_with_helpers(kernel)
    return kernel


def cached_with_helpers(kernel: numba.core.dispatcher.Dispatcher) -> None:
    """Have what is cached of a kernel not outlive a change of what it calls.

    numba looks at the kernel's own file only, not at helpers elsewhere that an upgrade changes.
    """
    cache = getattr(kernel, "_cache", None)  # numba has no public way; none without compiling
    file = getattr(cache, "_cache_file", None)
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
