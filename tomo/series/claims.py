"""Which process has which block of a store in hand: locks that end with their process."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Self

LOCK = Path("complete") / "lock"
"""The file whose bytes are locked, one a block, in a store's folder: inside an array, where no
reader of the store looks for groups."""


class Claims:
    """The blocks of a store that this process has in hand, for one run at a time.

    Where the system cannot lock parts of files (Windows, some network disks), every process gets
    every block: all write the same.

    Parameters
    ----------
    store : Path
        The folder of the store.
    """

    def __init__(self, store: Path) -> None:
        try:
            import fcntl
        except ImportError:
            self._system = None
        else:
            self._system = fcntl
        # one handle: POSIX takes all locks of a process away when it closes any handle of a file
        self._handle = os.open(store / LOCK, os.O_RDWR | os.O_CREAT, 0o666)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._handle)

    def take(self, block: range, *, wait: bool) -> bool:
        """Take a block; return whether it could be had.

        ``wait`` waits for the process that has it, until that has finished it or ended.
        """
        if self._system is None:
            return True
        how = self._system.LOCK_EX | (0 if wait else self._system.LOCK_NB)
        try:
            self._system.lockf(self._handle, how, 1, block.start)
        except (BlockingIOError, PermissionError):
            return False
        except OSError:  # a disk without locks
            return True
        return True

    def release(self, block: range) -> None:
        """Give a block back."""
        if self._system is not None:
            self._system.lockf(self._handle, self._system.LOCK_UN, 1, block.start)
