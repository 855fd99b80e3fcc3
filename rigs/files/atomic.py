"""Files that appear whole or not at all, and what killed writers left of them."""

from __future__ import annotations

import os
import platform
import re
import secrets
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PARTIAL = re.compile(r"\..*\.partial-([0-9a-f]{8})-(\d+)-[0-9a-f]{8}(\.[^.]*)?", re.DOTALL)


@contextmanager
def atomic_path(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a temporary name beside ``path``; rename it to ``path`` when the block succeeds.

    The temporary name has the suffix of ``path``, because many writers choose the format by it,
    and lies in the same folder, because a rename is atomic only within one file system. Missing
    folders are made. When the block raises, the temporary file is deleted and what stood at
    ``path`` before stands there still. A process that is killed leaves the temporary file to
    `remove_leftovers`.

    Parameters
    ----------
    path : path-like
        The file to write.

    Raises
    ------
    OSError
        Naming ``path``, where the block cannot write: no space left, no permission.

    Examples
    --------
    >>> with atomic_path("report.json") as temporary:
    ...     temporary.write_text("{}")
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(partial_name(path.stem[:40], path.suffix))
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        if error.filename not in (None, str(temporary), temporary):
            raise
        if error.errno is None:  # numpy's own: so many bytes asked for, so many written
            raise OSError(f"{path}: cannot be written: {error}") from error
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


def partial_name(stem: str, suffix: str = "") -> str:
    """Return a name for what is not yet whole; it tells which process of which machine writes."""
    return f".{stem}.partial-{_machine()}-{os.getpid()}-{secrets.token_hex(4)}{suffix}"


def remove_leftovers(folder: str | os.PathLike) -> list[Path]:
    """Remove what writers of this machine that were killed left half-written in ``folder``.

    Files of processes that still run, of other machines and of other names are left alone, and so
    is what may not be removed.

    Returns
    -------
    list of Path
        What was removed.
    """
    removed = []
    try:
        entries = list(os.scandir(folder))
    except PermissionError:  # a folder to drop files into
        return removed
    for entry in entries:
        found = _PARTIAL.fullmatch(entry.name)
        if found is None or found[1] != _machine() or _runs(int(found[2])):
            continue
        path = Path(entry.path)
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):  # another user's, in a folder that all may write to
                path.unlink()
        if not os.path.lexists(path):
            removed.append(path)
    return removed


def _machine() -> str:
    """Return a word for the machine, or the container on it, whose processes have our numbers."""
    try:
        numbers = os.readlink("/proc/self/ns/pid")
    except OSError:  # not on Linux
        numbers = ""
    return f"{zlib.crc32(f'{platform.node()} {numbers}'.encode()):08x}"


def _runs(process: int) -> bool:
    import psutil

    return psutil.pid_exists(process)
