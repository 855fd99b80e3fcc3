"""Compiling loops by numba, kept on disk where a folder can be written."""

from __future__ import annotations

from collections.abc import Callable

import numba


def compiled(function: Callable) -> Callable:
    """Return the function compiled when it is first called; it releases the interpreter's lock."""
    try:
        return numba.njit(function, cache=True, nogil=True, error_model="numpy")
    except RuntimeError:  # no folder to cache in can be written
        return numba.njit(function, nogil=True, error_model="numpy")
