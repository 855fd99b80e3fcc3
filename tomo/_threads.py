"""Work shared out between threads, each of which takes the next piece when it has done its last.

For kernels that let go of Python while they run. OpenMP's threads are woken for every parallel
loop and wait for each other at its end; these are woken once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import TypeVar

Piece = TypeVar("Piece")


def share_out(
    pieces: Iterable[Piece], threads: int, worker: Callable[[], Callable[[Piece], None]]
) -> None:
    """Do all pieces of some work on several threads, this one among them.

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
    left, lock, failed = iter(pieces), threading.Lock(), []

    def work() -> None:
        try:
            do = worker()
            while not failed:
                with lock:
                    piece = next(left, None)
                if piece is None:
                    return
                do(piece)
        except BaseException as error:  # an interrupt as well: the others have to end
            failed.append(error)

    others = [
        threading.Thread(target=work, daemon=True) for _ in range(min(threads, len(pieces)) - 1)
    ]
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
