"""Files, and folders of files that belong together, that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from rigs.files.atomic import atomic_path, partial_name, remove_leftovers

__all__ = ["atomic_path", "remove_leftovers", "whole_folder"]


@contextmanager
def whole_folder(
    folder: str | os.PathLike, last: Sequence[str], others: Sequence[str] = ()
) -> Iterator[Path]:
    """Yield an empty folder to write into; move its files to ``folder`` when the block succeeds.

    Until then ``folder`` stays as it is, whatever happens to the block. The files are moved one
    by one, within milliseconds, by one process at a time (where the system has ``flock``): of
    several that write into one folder, the last one's files stand there, all of them.

    Parameters
    ----------
    folder : path-like
        Made where it is missing.
    last : sequence of str
        Files that say that the others are complete: removed before the first file is moved,
        moved after all others, in this order.
    others : sequence of str
        Files of an earlier result, removed where the block has written none of that name.

    Raises
    ------
    OSError, ValueError
        Of the block, naming files in ``folder`` where they name those in the folder yielded.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    remove_leftovers(folder)
    staging = folder / partial_name("files")
    try:
        staging.mkdir()
        yield staging
        # In a thread, which Ctrl-C in the middle waits for: either result is whole, never half
        with _alone(folder), ThreadPoolExecutor(1) as mover:
            mover.submit(_move, staging, folder, last, others).result()
    except (OSError, ValueError) as error:
        _say_instead(error, staging, folder)
        raise
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _move(staging: Path, folder: Path, last: Sequence[str], others: Sequence[str]) -> None:
    files = [path.relative_to(staging) for path in staging.rglob("*") if path.is_file()]
    order = {Path(name): place for place, name in enumerate(last, 1)}
    for name in last:
        (folder / name).unlink(missing_ok=True)
    for name in {*map(Path, others)}.difference(files):
        (folder / name).unlink(missing_ok=True)
    for name in sorted(files, key=lambda name: order.get(name, 0)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        _replace(staging / name, folder / name)
    shutil.rmtree(staging, ignore_errors=True)


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


def _say_instead(error: OSError | ValueError, found: Path, wanted: Path) -> None:
    """Name ``wanted`` where an error names ``found``, or no file at all."""
    error.args = tuple(
        part.replace(str(found), str(wanted)) if isinstance(part, str) else part
        for part in error.args
    )
    if isinstance(error, OSError) and error.errno is not None:
        named = wanted if error.filename is None else error.filename
        error.filename = str(named).replace(str(found), str(wanted))
