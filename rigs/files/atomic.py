"""Files, and folders of files that belong together, that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import platform
import re
import secrets
import shutil
import threading
import zlib
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

_NO_FLUSH = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)
"""What systems say that cannot flush a folder: some network disks."""

_moving = threading.Lock()
"""Held by a thread that moves files which belong together, never by the main thread."""

_unfinished: set[Path] = set()
"""Temporary files and folders of the writers now at work in this process."""

_PARTIAL = re.compile(r"\..*\.partial-([0-9a-f]{8})-(\d+)-[0-9a-f]{8}(\.[^.]*)?", re.DOTALL)


@contextmanager
def atomic_path(path: str | os.PathLike, *, durable: bool = False) -> Iterator[Path]:
    """Yield a temporary name next to ``path``; rename it to ``path`` when the block succeeds.

    The temporary name has the suffix of ``path``, because many writers choose the format by it,
    and lies in the same folder, because a rename is atomic only within one file system. Missing
    folders are made. When the block raises, the temporary file is deleted and an earlier file at
    ``path`` stays as it was. A process that is killed leaves the temporary file to
    `remove_leftovers`.

    Parameters
    ----------
    path : path-like
        The file or folder to write.
    durable : bool
        Whether it is on the disk when the block ends: a later run goes on from it, and after a
        loss of power finds it whole or finds what was there before.

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
    temporary = path.with_name(_partial_name(path.stem[:40], path.suffix))
    try:
        with _registered(temporary):
            yield temporary
            if durable:
                flush_whole(temporary)
            os.replace(temporary, path)
            if durable:
                flush([path.parent])
    except OSError as error:
        if error.filename not in (None, str(temporary), temporary):
            raise
        if error.errno is None:  # NumPy's own error, of a short write
            raise OSError(f"{path}: cannot be written: {error}") from error
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def whole_folder(
    folder: str | os.PathLike, last: Sequence[str], others: Sequence[str] = ()
) -> Iterator[Path]:
    """Yield an empty folder to write into; move its files to ``folder`` when the block succeeds.

    Until then ``folder`` stays as it is, whatever happens to the block. The files are moved one
    by one, within milliseconds, by one process at a time (where the system has ``flock``). When
    several processes write into one folder, it ends with all the files of the last one.

    Parameters
    ----------
    folder : path-like
        Made where it is missing.
    last : sequence of str
        Files whose presence means that the others are complete: removed before the first file is
        moved, moved after all others, in this order.
    others : sequence of str
        Files of an earlier result, removed where the block has written none of that name.

    Raises
    ------
    OSError, ValueError
        Raised by the block; they name files in ``folder`` in place of the folder yielded.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    remove_leftovers(folder)
    staging = folder / _partial_name("files")
    try:
        with _registered(staging):
            staging.mkdir()
            yield staging
            # In a thread, which Ctrl-C waits for: either result is whole, never half
            with _alone(folder), ThreadPoolExecutor(1) as mover:
                mover.submit(_move, staging, folder, last, others).result()
    except (OSError, ValueError) as error:
        _rename_in(error, staging, folder)
        raise


def remove_leftovers(folder: str | os.PathLike[str]) -> list[Path]:
    """Remove the half-written files that killed processes of this machine left in ``folder``.

    Files of processes that still run, of other machines and of other names stay, and so do those
    that this user may not remove.

    Returns
    -------
    list of Path
        The files and folders removed.
    """
    removed: list[Path] = []
    try:
        entries = list(os.scandir(folder))
    except PermissionError:  # a folder to drop files into
        return removed
    for entry in entries:
        found = _PARTIAL.fullmatch(entry.name)
        if found is None or found[1] != _machine() or _runs(int(found[2])):
            continue
        path = Path(entry.path)
        _remove(path)
        if not os.path.lexists(path):
            removed.append(path)
    return removed


def remove_unfinished() -> None:
    """Remove what this process has half-written, just before a signal ends the process.

    Waits until files that are being moved have arrived; nothing is moved afterwards.
    """
    _moving.acquire()
    for temporary in list(_unfinished):
        _remove(temporary)


@contextmanager
def _registered(temporary: Path) -> Iterator[None]:
    """Remove a temporary file or folder after the block, or in it by `remove_unfinished`."""
    _unfinished.add(temporary)
    try:
        yield
    finally:
        _remove(temporary)
        _unfinished.discard(temporary)


def _remove(path: Path) -> None:
    """Remove a file or a folder, unless it is another user's."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


def _move(staging: Path, folder: Path, last: Sequence[str], others: Sequence[str]) -> None:
    files = [path.relative_to(staging) for path in staging.rglob("*") if path.is_file()]
    order = {Path(name): number for number, name in enumerate(last, 1)}
    with _moving:
        for name in last:
            (folder / name).unlink(missing_ok=True)
        for other in {*map(Path, others)}.difference(files):
            (folder / other).unlink(missing_ok=True)
        for file in sorted(files, key=lambda file: order.get(file, 0)):
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            _replace(staging / file, folder / file)


def _replace(source: Path, target: Path) -> None:
    try:
        os.replace(source, target)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        with atomic_path(target) as temporary:  # a folder inside is a link to another disk
            shutil.copyfile(source, temporary)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Wait until no other process moves files into ``folder``; a killed one does not count."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with ExitStack() as stack:
        with suppress(OSError):  # a folder may not be read, and some network disks lock none
            handle = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def _rename_in(error: OSError | ValueError, found: Path, wanted: Path) -> None:
    """Name ``wanted`` where an error names ``found``, or no file at all."""
    error.args = tuple(
        part.replace(str(found), str(wanted)) if isinstance(part, str) else part
        for part in error.args
    )
    if isinstance(error, OSError) and error.errno is not None:
        named = wanted if error.filename is None else error.filename
        error.filename = str(named).replace(str(found), str(wanted))


def _partial_name(stem: str, suffix: str = "") -> str:
    """Return a name for an unfinished file or folder, with the machine and process that writes."""
    return f".{stem}.partial-{_machine()}-{os.getpid()}-{secrets.token_hex(4)}{suffix}"


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


def flush(paths: Iterable[Path]) -> None:
    """Return once files, then folders, are on the disk: a folder's entry holds the names in it.

    So a file stays whole under its name. Windows flushes no folders.
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
