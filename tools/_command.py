"""What every command shares: bad input is one line and exit code 2; progress is on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import rich.console
import typer

console = rich.console.Console(stderr=True)


@contextmanager
def bad_input_in_one_line() -> Iterator[None]:
    """Turn the library's errors about input into one line on stderr and exit code 2."""
    try:
        yield
    except (ValueError, FileNotFoundError, IsADirectoryError, NotADirectoryError) as error:
        message = " ".join(str(error).split())
        typer.echo(f"error: {message}", err=True)
        raise typer.Exit(2) from None


def print_json(result: dict) -> None:
    """Print one JSON object on stdout."""
    sys.stdout.write(json.dumps(result, indent=2) + "\n")
