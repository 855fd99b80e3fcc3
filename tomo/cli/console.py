"""Progress and messages on stderr, one JSON object on stdout."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

import rich.console
import typer

console = rich.console.Console(stderr=True)

JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def say(line: str, style: str = "") -> None:
    """Print a line on stderr as it stands."""
    console.print(line, style=style, markup=False, highlight=False, soft_wrap=True)


def print_json(result: dict) -> None:
    """Print one JSON object on stdout."""
    sys.stdout.write(json.dumps(result, indent=2) + "\n")


def finite_or_none(value: float) -> float | None:
    """Return a number as JSON holds it: None for NaN and infinity."""
    return value if math.isfinite(value) else None


@contextmanager
def progress_bar(name: str) -> Iterator[Callable[[int, int, str], None]]:
    """Show a bar on stderr; call the yielded function with done, total and the current step."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f}%"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[step]}"),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(name, total=None, step="")

        def show(done: int, total: int, step: str = "") -> None:
            progress.update(task, completed=done, total=total, step=step)

        yield show
