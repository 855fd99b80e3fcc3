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

FRAMES = "frames"
"""The line of the frames, after those of the stages of planning."""

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
def frames_bar() -> Iterator[Callable[[int, int, str], None]]:
    """Show a line for each stage of planning, and one for the frames with their rate.

    Call the yielded function with done, total and the current step, see `tomo.series.stages`.
    """
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
    from rich.text import Text

    from tomo.series.stages import stage_of

    class Pace(ProgressColumn):
        """Frames a second and time left; of stages, the time they took."""

        def render(self, task: Task) -> Text:
            if task.description != FRAMES:
                return Text(f"{task.elapsed or 0:.1f} s")
            if task.finished:
                return Text(f"{task.completed:.0f} in {clock(task.finished_time or 0)}")
            if not task.speed:
                return Text("")
            left = "" if task.time_remaining is None else f", {clock(task.time_remaining)} left"
            return Text(f"{task.speed:.3g} frames/s{left}")

    columns = (
        TextColumn("{task.description}"),
        BarColumn(24),
        Pace(),
        TextColumn("{task.fields[step]}"),
    )
    with Progress(*columns, console=console, speed_estimate_period=60) as progress:
        tasks: dict[str, int] = {}

        def show(done: int, total: int, step: str = "") -> None:
            stage, step = stage_of(step)
            stage = stage or FRAMES
            if stage not in tasks:
                if tasks:
                    last = [*tasks.values()][-1]
                    progress.update(last, completed=1, total=1, step="")
                    progress.stop_task(last)
                tasks[stage] = progress.add_task(stage, total=None, step="")
            progress.update(tasks[stage], completed=done, total=total or None, step=step)

        yield show


def clock(seconds: float) -> str:
    """Return a time as minutes and seconds, or hours and minutes.

    >>> clock(65), clock(7500)
    ('1:05', '2 h 05')
    """
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d}"


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
