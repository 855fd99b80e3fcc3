"""Long calls side by side in processes, for results that no stopwatch is held to."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any, TypeVar
from unittest import mock

Result = TypeVar("Result")

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def results_of(
    function: Callable[..., Result], calls: Sequence[tuple[Any, ...]], processes: int
) -> Iterator[Result]:
    """Yield the result of every call as it comes: in turn in this process, or side by side.

    Parameters
    ----------
    function : callable
        Of a module, by name: what other processes can import.
    calls : sequence of tuple
        The arguments of each.
    processes : int
        Above one, the calls are shared out to so many processes of one thread each. They end with
        this generator, whatever they are at.

    Raises
    ------
    concurrent.futures.process.BrokenProcessPool
        If a process was killed.
    """
    if processes == 1:
        yield from (function(*call) for call in calls)
        return
    context = multiprocessing.get_context("spawn")
    with mock.patch.dict(os.environ, _ONE_THREAD):  # libraries have read theirs in this process
        pool = ProcessPoolExecutor(processes, context, initializer=_use_one_thread)
        try:
            for done in as_completed([pool.submit(function, *call) for call in calls]):
                yield done.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.kill()


def _use_one_thread() -> None:
    """Keep a process to its core, and leave Ctrl-C to the one that started it."""
    import numba
    import torch

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    numba.set_num_threads(1)
    torch.set_num_threads(1)
