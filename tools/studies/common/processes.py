"""Processes of one thread each that work through jobs."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from typing import Any
from unittest import mock

MOST = 2


def at_work(
    function: Callable[..., Any],
    jobs: Mapping[Any, tuple[Any, ...]],
    processes: int,
    seconds: float = float("inf"),
) -> Iterator[tuple[Any, Any]]:
    """Yield keys and results of jobs, given by their arguments, as they are done.

    None is begun after ``seconds``. Processes use one thread: two of them share two cores.
    """
    started = time.monotonic()
    one_thread = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    with mock.patch.dict(os.environ, one_thread), _pool(processes) as pool:
        running = {pool.submit(function, *job): key for key, job in jobs.items()}
        try:
            for done in as_completed(running):
                if time.monotonic() - started > seconds:
                    _cancel(running)
                if not done.cancelled():
                    yield running[done], done.result()
        finally:
            _cancel(running)


def _cancel(running: Iterable[Future[Any]]) -> None:
    for one in running:
        one.cancel()


def _pool(processes: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"))
