"""A process of its own that draws pictures while this one computes.

Libraries that draw take as long to load as a small volume takes to solve, and they keep Python's
lock: in a thread they would take from the computation what they save. The pictures are the same,
bit for bit, in either process.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any, Self, TypeVar

T = TypeVar("T")


class Artist:
    """Calls functions, one after the other, in a process that is started for it.

    Ends with the ``with`` block, and where this process ends in any way. Where it cannot start or
    is killed, as for want of memory, the functions are called in a thread of this process.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")  # numba's threads survive no fork
        self._here, there = context.Pipe()
        self._process = context.Process(target=_work, args=(there,), daemon=True)
        self._process.start()
        there.close()
        self._asking = ThreadPoolExecutor(1)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._asking.shutdown(cancel_futures=True)
        self._here.close()

    def ask(
        self,
        function: Callable[..., T],
        *values: Any,
        then: Callable[[T], object] = lambda found: None,
    ) -> Future[T]:
        """Return what a function of a module will return for values; both are pickled.

        ``then`` is called with it in a thread of this process.
        """
        return self._asking.submit(self._answer, function, values, then)

    def _answer(self, function: Callable[..., T], values: tuple, then: Callable[[T], object]) -> T:
        try:
            self._here.send((function, values))
            done, found = self._here.recv()
        except (EOFError, OSError):
            done, found = True, function(*values)
        if not done:
            raise found
        then(found)
        return found


def _work(there: Connection) -> None:
    """Call what is asked for until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks
    os.environ["NUMBA_NUM_THREADS"] = "1"  # the others compute
    while True:
        try:
            function, values = there.recv()
        except EOFError:
            return
        try:
            answer = True, function(*values)
        except Exception as error:  # raised again where it was asked for
            answer = False, error
        try:
            there.send(answer)
        except OSError:
            return
