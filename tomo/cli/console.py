"""Messages on stderr, one JSON object on stdout."""

from __future__ import annotations

import errno
import json
import logging
import math
import os
import shlex
import sys
from typing import Annotated

import typer

from rigs.progress import printable, stderr
from tomo.cli.errors import end

JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


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
