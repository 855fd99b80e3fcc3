"""Progress of long work: a callable, or a bar in a terminal or a notebook.

Functions that take long have a parameter ``progress``: None is silent, True shows a bar, and a
callable is called with the parts done, all parts (0: not known yet) and the step in words. Where
stderr is no terminal, as in a log, there is a line for each stage instead of a bar.
"""

from __future__ import annotations

import os
import time
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import ProgressColumn, TaskID

Progress = Callable[[int, int, str], None]
"""Called with what is done, its total and the step: ``progress(3, 33, "cam03")``."""

STAGE = "plan: "
"""How steps begin that are a stage by itself, with a line of its own."""

PAUSE = 10.0
"""Seconds between two lines of one stage where there is no terminal: more often fills logs."""

_OBEYED = ("Cc", "Cf", "Zl", "Zp")
"""Kinds of characters that terminals obey: controls, marks of direction, breaks of lines."""

WHOLE = "whole"
"""The step that tells of all stages together, in tenths of seconds: spent, and spent and left."""

FRAMES = "frames"
"""The name of a bar that counts frames: it says their rate."""


@contextmanager
def progress_of(progress: Progress | bool | None, name: str) -> Iterator[Progress | None]:
    """Give what progress is reported to while the block runs: a callable as it is, or None.

    True shows a bar called ``name`` on stderr, or below the cell of a notebook.

    >>> with progress_of(lambda done, total, step: print(done, total, step), "trace") as tell:
    ...     tell(1, 3, "cam00")
    1 3 cam00
    """
    if progress is True:
        console = stderr()
        with (_bar if console.is_terminal or console.is_jupyter else _lines)(name) as show:
            yield show
        return
    if progress and not callable(progress):
        raise ValueError(f"progress: found {progress!r}, expected True, None or a callable")
    yield progress or None


def staged(progress: Progress | None) -> Callable[[str], Progress | None]:
    """Return a function that begins a stage by name, and gives what its progress is reported to.

    >>> stage = staged(lambda done, total, where: print(done, total, where))
    >>> stage("tracing")(1, 5, "cam01")
    0 1 plan: tracing
    1 5 plan: tracing: cam01
    """

    def begin(name: str) -> Progress | None:
        if progress is None:
            return None
        progress(0, 1, f"{STAGE}{name}")

        def tell(done: int, total: int, where: str) -> None:
            progress(done, total, f"{STAGE}{name}: {where}")

        return tell

    return begin


def stage_of(step: str) -> tuple[str, str]:
    """Return the stage of a step, empty where it has no line of its own, and the rest.

    >>> stage_of("plan: tracing: cam01"), stage_of("frame 7")
    (('tracing', 'cam01'), ('', 'frame 7'))
    """
    if not step.startswith(STAGE):
        return "", step
    stage, _, rest = step.removeprefix(STAGE).partition(": ")
    return stage, rest


def clock(seconds: float) -> str:
    """Return a time as minutes and seconds, or hours and minutes.

    >>> clock(65), clock(7500)
    ('1:05', '2 h 05')
    """
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d}"


@cache
def stderr() -> Console:
    """Return the console of bars and messages."""
    return console(stderr=True)


def console(*, stderr: bool = False) -> Console:
    """Return a console of the terminal's width; COLUMNS=0, which shows nothing, is none."""
    from rich.console import Console

    columns = os.environ.get("COLUMNS", "")
    is_none = columns.isdecimal() and int(columns) == 0
    return Console(stderr=stderr, width=80 if is_none else None)


@contextmanager
def _lines(name: str) -> Iterator[Progress]:
    """Print a line when a stage begins, and then how far it is, at most one in `PAUSE` seconds."""
    began = last = time.monotonic()
    current: str | None = None
    parts, whole = 0, ""

    def show(done: int, total: int, step: str = "") -> None:
        nonlocal current, last, parts, whole
        if step == WHOLE:
            whole = f" ({_left(done, total)})"
            return
        stage, step = stage_of(step)
        now, parts = time.monotonic(), 0 if stage else done
        if stage == current and now - last < PAUSE:
            return
        is_new, current, last = stage != current, stage, now
        share = f"{done / total:.0%}" if total else ""
        words = [part for part in (stage, "" if stage and is_new else share, step) if part]
        say(f"{name} {clock(now - began)}{whole}: {', '.join(words) or 'at work'}")

    def say(line: str) -> None:
        stderr().print(line, markup=False, highlight=False, soft_wrap=True)

    yield show
    if parts:
        took = clock(time.monotonic() - began)
        say(f"{name} {took}: {parts} in {took}")


@contextmanager
def _bar(name: str) -> Iterator[Progress]:
    """Show a line for each stage, and one for the rest of the work."""
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description}"),
        BarColumn(24),
        _pace(),
        TextColumn("{task.fields[step]}"),
    )
    with Bars(*columns, console=stderr(), speed_estimate_period=60) as bars:
        lines: dict[str, TaskID] = {}
        whole: dict[str, TaskID] = {}  # the line of all stages together: one at most, the last

        def show_whole(done: int, total: float | None) -> None:
            for old in whole.values():
                bars.remove_task(old)
            whole[name] = bars.add_task(name, completed=done, total=total, step="", kind=WHOLE)

        show_whole(0, None)

        def end_last() -> None:
            for last in [*lines.values()][-1:]:
                bars.update(last, completed=1, total=1, step="")
                bars.stop_task(last)

        def show(done: int, total: int, step: str = "") -> None:
            if step == WHOLE:
                return show_whole(done, total)
            stage, step = stage_of(step)
            if (line := stage or name) not in lines:
                end_last()
                kind = STAGE if stage else ""
                lines[line] = bars.add_task(line, total=None, step="", kind=kind)
                for old in list(whole.values()):
                    known = next(task for task in bars.tasks if task.id == old)
                    if known.total:  # it comes below the stages
                        show_whole(int(known.completed), known.total)
                    else:  # the first line takes the place of the one that waits for it
                        bars.remove_task(whole.pop(name))
            bars.update(lines[line], completed=done, total=total or None, step=step)

        yield show
        if name not in lines:
            end_last()


def _left(done: float, total: float) -> str:
    """Return how far the whole is, of tenths of seconds.

    >>> _left(30, 120)
    '25 %, 0:09 left'
    """
    return f"{done / max(total, 1):.0%}, {clock((total - done) / 10)} left".replace("%", " %", 1)


def _pace() -> ProgressColumn:
    """Return a column: frames a second, or percents, and the time left; of stages, their time."""
    from rich.progress import ProgressColumn, Task
    from rich.text import Text

    class Pace(ProgressColumn):
        def render(self, task: Task) -> Text:
            left = task.time_remaining
            words = "" if left is None else f", {clock(left)} left"
            if task.fields["kind"] == WHOLE:
                return Text(_left(task.completed, task.total) if task.total else "")
            if task.fields["kind"] == STAGE:
                return Text(f"{task.percentage:3.0f} %, {task.elapsed or 0:.1f} s")
            if task.description != FRAMES:
                return Text(f"{task.percentage:3.0f} %{words}" if task.total else "")
            if task.finished:
                return Text(f"{task.completed:.0f} in {clock(task.finished_time or 0)}")
            return Text(f"{task.speed:.3g} frames/s{words}" if task.speed else "")

    return Pace()


def printable(text: str) -> str:
    r"""Return a text whose control characters are written out, like ``\x1b``; lines stay lines.

    A terminal obeys them, and names of files may hold them.
    """
    return "".join(
        one if one == "\n" or unicodedata.category(one) not in _OBEYED else _written_out(one)
        for one in text
    )


def _written_out(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
