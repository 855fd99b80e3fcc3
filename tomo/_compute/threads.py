"""How many threads work is worth, and work shared out between threads of our own.

OpenMP's threads sleep between parallel loops. To wake one for every loop, and to wait for it at
the end, takes some 0.06 ms: small loops are quicker without it (`threads_worth`). Large work of
kernels that let go of Python while they run is shared out between threads that are woken once,
each of which takes the next piece when it has done its last (`share_out`).
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TypeVar

import numba

Piece = TypeVar("Piece")

WORTH_WAKING = 100_000.0
"""Nanoseconds of one thread's work that another is woken for."""


@contextmanager
def threads_worth(nanoseconds: float) -> Iterator[None]:
    """Have parallel loops in the block wake no more threads than their work is worth.

    Parameters
    ----------
    nanoseconds : float
        That the work of one parallel loop takes one thread, roughly. Results must not depend on
        the number of threads, as nowhere here.
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


def share_out(
    pieces: Iterable[Piece], threads: int, worker: Callable[[], Callable[[Piece], None]]
) -> None:
    """Do all pieces of some work on several threads, this one among them.

    On several threads there are no more to be had inside a piece: `numba.get_num_threads` is 1.

    Parameters
    ----------
    pieces : iterable
        Gone through before any is done.
    threads : int
        At most so many take part; fewer where there are fewer pieces.
    worker : callable
        Called on each thread once; returns what does one piece there, with memory of its own.

    Raises
    ------
    BaseException
        What a thread raised first; pieces not begun by then are not done.
    """
    pieces = list(pieces)
    threads = min(threads, len(pieces))
    left, lock, failed = iter(pieces), threading.Lock(), []

    def work() -> None:
        try:
            with threads_worth(0) if threads > 1 else nullcontext():
                do = worker()
                while not failed:
                    with lock:
                        piece = next(left, None)
                    if piece is None:
                        return
                    do(piece)
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


def share_range(count: int, work: Callable[[int, int], None]) -> None:
    """Call ``work(start, stop)`` for parts of ``range(count)`` that make up all of it.

    On as many threads as numba has here. On one it is called once.
    """
    threads = numba.get_num_threads()
    parts = max(min(4 * threads, count), 1) if threads > 1 else 1
    cuts = [part * count // parts for part in range(parts + 1)]
    share_out(itertools.pairwise(cuts), threads, lambda: lambda cut: work(*cut))
