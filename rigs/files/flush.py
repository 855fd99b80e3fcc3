"""Files and folders that stay when the power fails: flushed from memory to the disk."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from pathlib import Path

_NO_FLUSH = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)
"""What systems say that cannot flush a folder: some network disks."""


def flush(paths: Iterable[Path]) -> None:
    """Return once files and folders are on the disk, one after the other.

    A folder's own entry holds the names in it. So a file stays whole under its name once the file
    and then its folder are flushed. Windows flushes no folders.

    Raises
    ------
    OSError
        If the disk could not keep one of them.
    """
    for path in paths:
        is_folder = path.is_dir()
        if is_folder and os.name == "nt":
            continue
        handle = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
        try:
            os.fsync(handle)
        except OSError as error:
            if not is_folder or error.errno not in _NO_FLUSH:
                raise
        finally:
            os.close(handle)


def flush_whole(path: Path) -> None:
    """Flush a file, or a folder with all that is in it, the innermost first."""
    inside = sorted(path.rglob("*"), key=lambda one: (one.is_dir(), -len(one.parts)))
    flush([*inside, path])
