"""Reading ahead and writing behind: a thread each, with bounded queues between."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
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
def write_behind(write: Callable[[T], None], most: int) -> Iterator[Callable[[T], None]]:
    """Yield what takes items for ``write``, which a thread calls in order; at most so many wait.

    What ``write`` raises, the next item or the end of the block raises. All is written by then.
    """
    waiting: queue.Queue[Any] = queue.Queue(most)
    failed: list[BaseException] = []

    def work() -> None:
        while (item := waiting.get()) is not _END:
            if failed:
                continue  # so that nobody waits to put
            try:
                write(item)
            except BaseException as error:  # raised by the one who puts
                failed.append(error)

    def put(item: T) -> None:
        if failed:
            raise failed[0]
        waiting.put(item)

    writer = threading.Thread(target=work, daemon=True)
    writer.start()
    try:
        yield put
    finally:
        waiting.put(_END)
        writer.join()
    if failed:
        raise failed[0]
