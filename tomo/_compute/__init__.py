"""Compiled kernels, threads, deterministic sums, arrays of any library, memory."""

import os


def set_passive_waiting() -> None:
    """Set ``OMP_WAIT_POLICY=passive`` unless it is set: OpenMP's threads sleep, and do not spin.

    It costs 5 microseconds a kernel on free cores, and saves milliseconds on busy ones. OpenMP
    reads the environment when it is loaded, with numba's threads or with PyTorch: call this first.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
