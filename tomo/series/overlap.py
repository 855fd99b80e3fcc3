"""Reading ahead and writing behind: a thread each."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")

_END = object()
_PATIENCE = 0.2
"""Seconds after which the reader looks whether it is still wanted: shorter wakes for nothing."""


@contextmanager
def read_ahead(items: Iterator[T], most: int) -> Iterator[Iterator[T]]:
    """Yield an iterator over ``items``, which a thread takes ahead, at most so many.

    What the thread raises is raised where the item would have come. It ends with the block.
    """
    waiting: queue.Queue[Any] = queue.Queue(most)
    ended = threading.Event()

    def put(item: Any) -> bool:
        while not ended.is_set():
            try:
                waiting.put(item, timeout=_PATIENCE)
                return True
            except queue.Full:
                continue
        return False

    def work() -> None:
        try:
            for item in items:
                if not put((item, None)):
                    return
            put((_END, None))
        except BaseException as error:  # raised by the one who waits
            put((_END, error))

    def take() -> Iterator[T]:
        while True:
            item, error = waiting.get()
            if error is not None:
                raise error
            if item is _END:
                return
            yield item

    reader = threading.Thread(target=work, daemon=True)
    reader.start()
    try:
        yield take()
    finally:
        ended.set()
        reader.join(_PATIENCE)  # not for ever: it may wait for a file or another process


@contextmanager
def write_behind(write: Callable[[T], object]) -> Iterator[Callable[[T], None]]:
    """Yield what takes items for ``write``, which a thread calls while the next one is made.

    What ``write`` raises, the next item or the end of the block raises. All is written by then.
    """
    last: list[Future] = []

    def put(item: T) -> None:
        for one in last:
            one.result()
        last[:] = [writer.submit(write, item)]

    with ThreadPoolExecutor(1) as writer:
        yield put
    for one in last:
        one.result()
