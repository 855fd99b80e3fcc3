"""Ctrl-C and SIGTERM end a command in one line and leave nothing half-written."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import suppress

LINES = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}

_kept: list[str] = []
"""What is there already when a signal comes."""

_SHOW_CURSOR = "\x1b[?25h\n"
"""Progress bars hide the cursor of a terminal."""


def run(command: Callable[[], object]) -> None:
    """Run a command that imports its libraries itself, so that a signal ends their import too.

    While the command works, either signal removes what is half-written, prints one line and ends
    the process with exit code 130 or 143, as shells report them. Once the command has returned,
    signals change nothing: its files and its exit code stand. A signal that the caller of the
    process had ignored, as shells do with Ctrl-C in the background, stays ignored.
    """
    for number in LINES:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)
    try:
        command()
    finally:
        _ignore()
        _kept.clear()


def keep(words: str) -> None:
    """Have a signal say, in place of what it said before, what it leaves."""
    _kept[:] = [words]


def _stop(number: int, frame: object) -> None:
    """End the process at once: exceptions can be swallowed, and threads may work for hours."""
    _ignore()
    with suppress(Exception):  # while that module is imported, nothing is half-written yet
        from rigs.files.atomic import remove_unfinished

        remove_unfinished()
    with suppress(OSError):  # nobody reads stderr any more
        start = _SHOW_CURSOR if os.isatty(2) else ""
        line = "; ".join([LINES[signal.Signals(number)], *_kept])
        os.write(2, f"{start}{line}\n".encode(errors="backslashreplace"))
    os._exit(128 + number)


def _ignore() -> None:
    """Ignore both signals. Python takes its own handlers away while it ends."""
    for number in LINES:
        signal.signal(number, signal.SIG_IGN)
