"""Bad input is one line on stderr and exit code 2; a failure of the system is exit code 1."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import typer

from rigs.progress import printable

_ABOUT_A_PATH = (
    FileNotFoundError,
    FileExistsError,
    IsADirectoryError,
    NotADirectoryError,
    PermissionError,
)


@contextmanager
def bad_input_in_one_line() -> Iterator[None]:
    """Turn errors about input, memory and files into one line on stderr.

    Exit codes are 2 for input, including input that needs too much memory, and 1 for files that
    the system refuses to read or write (a full disk), for a solver that diverged and for a GPU
    that was lost.
    """
    from tomo._compute.memory import check_address_space
    from tomo.operators.gpu import DeviceError

    try:
        check_address_space()
        _check_compiling()
        yield
    except BrokenPipeError:
        raise  # typer ends the command quietly
    except Exception as error:
        if isinstance(error, (ValueError, *_ABOUT_A_PATH)):
            end(f"error: {_one_line(error)}", 2)
        if isinstance(error, (OSError, FloatingPointError, DeviceError)):
            is_input = getattr(error, "errno", None) == errno.ENAMETOOLONG
            end(f"error: {_one_line(error)}", 2 if is_input else 1)
        if not _is_for_want_of_memory(error):
            raise
        end(
            f"error: memory: found too little left, expected enough: use fewer voxels, smaller "
            f"images or another method ({_one_line(error)})",
            2,
        )


def _check_compiling() -> None:
    """Raise where NUMBA_DISABLE_JIT is set: a run of seconds would take hours."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0").strip() not in ("", "0"):
        raise ValueError(
            f"NUMBA_DISABLE_JIT: found {os.environ['NUMBA_DISABLE_JIT']!r} in the environment, "
            "expected none: loops would not be compiled, and take a thousand times as long"
        )


def end(line: str, code: int) -> NoReturn:
    """End the command with one line on stderr and an exit code."""
    typer.echo(printable(line), err=True)
    raise typer.Exit(code) from None


def _one_line(error: Exception) -> str:
    """Return the message of an error in one line, the file first where the system names one."""
    message = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        message = f"{error.filename}: {error.strerror}"
    return _with_options(" ".join(message.split())) or type(error).__name__


def _with_options(message: str) -> str:
    """Return a message with options in place of arguments of Python.

    >>> _with_options("screen=False reconstructs all the same, and channel='g'")
    '--no-screen reconstructs all the same, and --channel g'
    """

    def option(found: re.Match) -> str:
        name, value = found[1].replace("_", "-"), found[2]
        if value in ("True", "False"):
            return f"--{name}" if value == "True" else f"--no-{name}"
        return f"--{name} {value[1:-1]}"

    return re.sub(r"\b([a-z_]+)=(True|False|'[^']*')", option, message)


def _is_for_want_of_memory(error: BaseException) -> bool:
    """Return whether memory ran out: libraries report that as errors of several types."""
    words = ("allocate memory", "out of memory", "failed to map segment", "start new thread")
    if not isinstance(error, (RuntimeError, ImportError)):
        return isinstance(error, MemoryError)
    return any(word in str(error).lower() for word in words)
