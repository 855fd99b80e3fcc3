"""A command from its first import to the end of its process: Ctrl-C and SIGTERM end it in a line.

Every command hands over to `run` before it imports anything else. Until `run` is there, which is
as long as Python itself takes to start, the signals are Python's to deal with.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from importlib import import_module

LINES = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}

_PATIENCE = 0.2
"""Seconds after which `Stopped` is raised once more where it was swallowed."""


class Stopped(BaseException):
    """The user or the system asked the command to end."""


def run(file: str) -> None:
    """Run the command of a file in ``tools/``; end the process with its exit code, never return.

    As long as the command works, either signal raises `Stopped` in it, so that what is
    half-written is removed; one line and exit code 130 or 143 follow, as shells give them.
    Once its work is done, the signals change nothing: results and exit code stand. A signal that
    who started the process had it ignore, as shells do with Ctrl-C in the background, stays so.

    Parameters
    ----------
    file : str
        The command's ``__file__``; its module has the command as ``app``.
    """
    stops = _Stops()
    stops.hear()
    try:
        try:
            import_module(os.path.splitext(os.path.basename(file))[0]).app()
        finally:
            stops.ended = True
    except SystemExit:
        stops.ignore()
        raise
    except BaseException:
        stops.ignore()
        if stops.asked is None:
            raise
    stops.end()


def was_asked_to_stop() -> bool:
    """Tell whether a signal came: whatever fails after that fails for it."""
    handlers = map(signal.getsignal, LINES)
    return any(isinstance(one, _Stops) and one.asked is not None for one in handlers)


class _Stops:
    """Handles the signals: raises `Stopped` where the main thread is, as long as it works.

    Attributes
    ----------
    asked : int or None
        The signal that came first.
    ended : bool
        Whether the command has ended, well or not.
    """

    asked: int | None = None
    ended = False

    def hear(self) -> None:
        """Handle the signals that are not ignored."""
        for number in LINES:
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self)

    def __call__(self, number: int, frame: object) -> None:
        if self.ended or _is_on_its_way():  # what was begun to be cleaned up is not broken off
            return
        if self.asked is None:
            self.asked = number
            _say_no_more()
            if hasattr(signal, "setitimer"):
                signal.signal(signal.SIGALRM, self)
                signal.setitimer(signal.ITIMER_REAL, _PATIENCE, _PATIENCE)
        raise Stopped

    def ignore(self) -> None:
        """Ignore the signals until the process is gone.

        Python's own handlers would be taken away while it ends: the signals would kill it.
        """
        for number in LINES:
            signal.signal(number, signal.SIG_IGN)
        if self.asked is not None and hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, signal.SIG_IGN)

    def end(self) -> None:
        """Say that the command was stopped, and end the process.

        At once: what was broken off in its middle, an import of a library, may not survive that
        Python puts everything away, and threads may have hours of work left.
        """
        with suppress(OSError):  # nobody listens
            os.write(2, f"{LINES[self.asked]}\n".encode())
        os._exit(128 + self.asked)


def _is_on_its_way() -> bool:
    """Tell whether the main thread is in an ``except`` or ``finally`` that `Stopped` led to."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, Stopped):
        error = error.__context__
    return error is not None


def _say_no_more() -> None:
    """Keep Python from telling of what comes of the stop where nothing can be raised."""

    def silent(*_: object) -> None:
        pass

    sys.excepthook = sys.unraisablehook = silent
    if "threading" in sys.modules:
        sys.modules["threading"].excepthook = silent
