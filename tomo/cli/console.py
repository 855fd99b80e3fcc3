"""Help on 80 columns, messages on stderr, JSON on stdout, errors as one line with an exit code."""

from __future__ import annotations

import errno
import json
import logging
import math
import os
import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from typer.core import TyperCommand

from rigs.progress import printable, stderr

if TYPE_CHECKING:
    from typer._click.exceptions import UsageError
else:
    UsageError = typer.BadParameter.__base__  # typer's own or click's, as the version has it

_NO_BREAK = "\N{NON-BREAKING HYPHEN}"
"""Stands for a hyphen while lines are broken, so that no name is cut."""

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
    """Return a message with options in place of arguments of Python: ``a=True`` is ``--a``."""

    def option(found: re.Match) -> str:
        name, value = found[1], found[2]
        if value in ("True", "False"):
            return flag(name if value == "True" else f"no_{name}")
        return f"{flag(name)} {value[1:-1]}"

    return re.sub(r"\b([a-z_]+)=(True|False|'[^']*')", option, message)


def flag(name: str) -> str:
    """Return the option of a parameter or field, as it is typed."""
    return "--" + name.rstrip("_").replace("_", "-")


def _is_for_want_of_memory(error: BaseException) -> bool:
    """Return whether memory ran out: libraries report that as errors of several types."""
    words = ("allocate memory", "out of memory", "failed to map segment", "start new thread")
    if not isinstance(error, (RuntimeError, ImportError)):
        return isinstance(error, MemoryError)
    return any(word in str(error).lower() for word in words)


def say(line: str, style: str = "") -> None:
    """Print a line on stderr as it stands."""
    stderr().print(printable(line), style=style, markup=False, highlight=False, soft_wrap=True)


class Escaped(logging.Formatter):
    """Log lines whose control characters are written out."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record."""
        return printable(super().format(record))


def typed() -> str:
    """Return the command line that runs, to be typed again."""
    return shlex.join([os.path.basename(sys.argv[0]), *sys.argv[1:]])


def print_json(result: dict) -> None:
    """Print one JSON object on stdout; where that is closed, end the command in one line."""
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        sys.stdout.write(json.dumps(result, indent=2) + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        raise  # typer ends the command quietly
    except OSError as error:
        sys.stdout = None  # as Python has it: nothing is flushed at the end
        end(f"error: stdout: {error.strerror or error}: the files are written, --json is not", 1)


def finite_or_none(value: float) -> float | None:
    """Return a number as JSON holds it: None for NaN and infinity."""
    return value if math.isfinite(value) else None


class OneLineUsage(TyperCommand):
    """A command whose errors about its options and arguments are one line, with exit code 2."""

    def make_context(
        self, info_name: str | None, args: list[str], *rest: Any, **extra: Any
    ) -> Any:
        """Return the context of the parsed arguments, or say in one line what is wrong."""
        try:
            return super().make_context(info_name, args, *rest, **extra)
        except UsageError as error:
            path = error.ctx.command_path if error.ctx else "flametomo"
            line = f"error: {self._message(error)}; see {path} --help"
            end(" ".join(line.split()), 2)

    def _message(self, error: Any) -> str:
        """Return the option, what was found, what was expected."""
        param = getattr(error, "param", None)
        unknown = getattr(error, "option_name", None)
        if unknown and "requires" not in error.message:
            return self._unknown(unknown)
        if param is None:
            return error.format_message().rstrip(".")
        is_option = param.param_type_name == "option"
        name = param.opts[0] if is_option else param.metavar or param.name.upper()
        if not error.message:  # nothing was given
            about = (getattr(param, "help", None) or "a value").rstrip(".")
            return f"{name}: missing, expected: {about}"
        return f"{name}: {error.message.rstrip('.')}"

    def _unknown(self, option: str) -> str:
        """Return what to use in place of an option that is misspelt."""
        from rigs.files.text import nearest

        known = [name for one in self.params for name in (*one.opts, *one.secondary_opts)]
        near = nearest(option, known)
        return f"{option}: no such option" + (f", did you mean {near}?" if near else "")

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the parts of the usage line."""
        return [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write one section for the arguments and one for each panel of options."""
        sections: dict[str, list] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            is_option = param.param_type_name == "option"
            panel = getattr(param, "rich_help_panel", None)
            title = panel or ("Options" if is_option else "Arguments")
            record = param.get_help_record(ctx)
            if record is not None:
                names, text = record
                names = names if is_option else re.sub(" <.*", "", names)  # no type
                sections.setdefault(title, []).append((names, text))
        for title, records in sections.items():
            if not records:
                continue
            with formatter.section(title):
                formatter.write_dl([(n, text.replace("-", _NO_BREAK)) for n, text in records])
        formatter.buffer[:] = [part.replace(_NO_BREAK, "-") for part in formatter.buffer]
