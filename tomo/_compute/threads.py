"""How many threads work is worth, and chunks of work that threads take in turn.

OpenMP's threads sleep between parallel loops. Waking one and waiting for it takes some 0.06 ms:
small loops are faster without it (`threads_worth`). Large work in kernels that release Python's
lock is cut into chunks; each thread takes the next chunk when its last is done (`run_chunks`).
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TypeVar

import numba

Chunk = TypeVar("Chunk")

WORTH_WAKING = 100_000.0
"""Nanoseconds of work for each thread: less spends the time on waking, more leaves cores idle."""


@contextmanager
def threads_worth(nanoseconds: float) -> Iterator[None]:
    """Limit parallel loops in the block to as many threads as their work is worth.

    ``nanoseconds`` is the rough time of one loop on one thread. No result may depend on the
    number.
    """
    threads = numba.get_num_threads()
    worth = max(1, int(nanoseconds / WORTH_WAKING))
    if worth >= threads:
        yield
        return
    numba.set_num_threads(worth)
    try:
        yield
    finally:
        numba.set_num_threads(threads)


def run_chunks(
    chunks: Iterable[Chunk], threads: int, worker: Callable[[], Callable[[Chunk], None]]
) -> None:
    """Do all chunks of some work on at most so many threads, this one among them.

    With several threads, `numba.get_num_threads` is 1 inside a chunk. ``worker`` is called once on
    each thread; returns the function that does one chunk there, with memory of its own. The first
    exception of a thread is raised, whatever its kind; no chunk begins after it.
    """
    chunks = list(chunks)
    threads = min(threads, len(chunks))
    left, lock = iter(chunks), threading.Lock()
    failed: list[BaseException] = []

    def work() -> None:
        try:
            with threads_worth(0) if threads > 1 else nullcontext():
                do = worker()
                while not failed:
                    with lock:
                        chunk = next(left, None)
                    if chunk is None:
                        return
                    do(chunk)
        except BaseException as error:  # an interrupt as well: the others have to end
            failed.append(error)

    others = [threading.Thread(target=work, daemon=True) for _ in range(threads - 1)]
    try:
        for other in others:
            other.start()
        work()
        for other in others:
            other.join()
    except BaseException as error:  # no thread to be had, or an interrupt: those begun end
        failed.append(error)
        raise
    if failed:
        raise failed[0]


def run_ranges(count: int, work: Callable[[int, int], None]) -> None:
    """Call ``work(start, stop)`` for ranges that together are ``range(count)``.

    On as many threads as numba has here; on one thread, one call.
    """
    threads = numba.get_num_threads()
    parts = max(min(4 * threads, count), 1) if threads > 1 else 1
    cuts = [part * count // parts for part in range(parts + 1)]
    run_chunks(itertools.pairwise(cuts), threads, lambda: lambda cut: work(*cut))
