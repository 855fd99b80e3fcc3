"""One reading, watched: what it raises, how long it takes, its memory, what it does besides."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from _stress.fuzzing_coverage import PACKAGES, Coverage

LIMIT = 2.0  # seconds of CPU time that a reader may take
MEMORY = 200 << 20  # bytes beyond four times the file that it may take
_TICK = 0.05  # seconds between signals once the limit is reached
_ROOTS = tuple(f"{Path(__file__).parents[2] / name}{os.sep}" for name in PACKAGES)
_WRITES = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink"}
_WRITES |= {"os.truncate", "os.chmod", "os.chown", "os.utime", "os.setxattr", "shutil.rmtree"}
_CODE = {"os.system", "os.exec", "os.posix_spawn", "os.fork", "os.forkpty", "subprocess.Popen"}
_CODE |= {"pickle.find_class", "socket.connect", "socket.bind", "urllib.Request", "ctypes.dlopen"}


class TooLong(BaseException):
    """Raised in a reader that takes too long; readers catch all that is an Exception."""


class Forbidden(BaseException):
    """Raised instead of what a reader must not do."""


@dataclass(frozen=True)
class Watched:
    """What came of one reading.

    Attributes
    ----------
    fault : str
        What must not be; empty where all is well.
    new_statements : int
        Of the project, reached for the first time.
    seconds : float
        Of CPU time.
    memory : int
        Bytes beyond four times the file.
    """

    fault: str
    new_statements: int
    seconds: float
    memory: int


class Guard:
    """Watches readings in this process, whose audit it hears from now on."""

    def __init__(self) -> None:
        self.coverage = Coverage()
        self._armed, self._heard, self._until, self._floor = False, "", 0.0, 0
        sys.addaudithook(self._audit)
        signal.signal(signal.SIGPROF, self._too_long)

    def watch(self, read: Callable[[Path], object], path: Path, size: int) -> Watched:
        """Read a file of ``size`` bytes."""
        before = self.coverage.statements
        if not self._floor:
            self._floor = _forget_peak()
        fault, seconds = self._timed(read, path)
        if not fault and seconds > LIMIT:  # in C code that no signal interrupts
            fault = f"TooLong: {seconds:.1f} s"
        memory = _peak() - self._floor
        if memory > MEMORY // 4:
            self._floor = _forget_peak()
        memory = max(memory - 4 * size, 0)
        if not fault and memory > MEMORY:
            fault = f"{memory >> 20} MB beyond four times the file"
        return Watched(fault, self.coverage.statements - before, seconds, memory)

    def warm(self, read: Callable[[Path], object], path: Path) -> None:
        """Read a file for what reading it imports; nothing is judged."""
        self._timed(read, path)
        self._floor = 0  # what was imported stays

    def _timed(self, read: Callable[[Path], object], path: Path) -> tuple[str, float]:
        self._heard = ""
        began = time.process_time()
        try:
            self._until = began + LIMIT
            signal.setitimer(signal.ITIMER_PROF, LIMIT, _TICK)
            self._armed = True
            try:
                fault = _fault_of(read, path)
            finally:
                self._armed = False
                signal.setitimer(signal.ITIMER_PROF, 0)
        except TooLong as error:  # at the last moment
            fault = _described(error)
        return self._heard or fault, time.process_time() - began

    def _too_long(self, signum: int, frame: FrameType | None) -> None:
        if self._armed and time.process_time() > self._until:  # the timer may be early
            raise TooLong(f"more than {LIMIT:g} s")

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self._armed:
            return
        if event == "open":
            path, mode, flags = arguments
            writes = isinstance(mode, str) and set(mode) & set("wax+")
            writes = writes or (flags or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if writes and path != os.devnull:
                self._refuse(f"wrote {path!r}")
        elif event in _WRITES:
            self._refuse(f"wrote: {event} {arguments!r}")
        elif event in _CODE:
            self._refuse(f"executed: {event} {arguments!r}")
        elif (
            event == "exec"
            and getattr(arguments[0], "co_filename", "") == "<string>"
            and not _importing()
        ):
            self._refuse(f"executed: {arguments[0].co_names}")

    def _refuse(self, what: str) -> None:
        self._heard = what
        raise Forbidden(what)


def _importing() -> bool:
    """Say whether a module is being imported: many make classes of text."""
    frame = sys._getframe()
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


def _fault_of(read: Callable[[Path], object], path: Path) -> str:
    """Return what is wrong with how a file was read or refused."""
    try:
        read(path)
    except (ValueError, OSError) as error:
        lines = str(error).splitlines()
        if len(lines) != 1 or not lines[0].strip():
            return f"{_described(error)}: {len(lines)} lines"
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever else is a fault
        return _described(error)
    return ""


def _described(error: BaseException) -> str:
    """Return the kind of an error, where in the project it came from, and what it says."""
    places = [
        place
        for place in traceback.extract_tb(error.__traceback__)
        if place.filename.startswith(_ROOTS)
    ]
    where = ""
    if places:
        where = f" ({Path(places[-1].filename).name}:{places[-1].lineno})"
    said = " ".join(str(error).split())[:80]
    return f"{type(error).__name__}{where}: {said}"


def _peak() -> int:
    """Return the largest memory of this process so far, in bytes."""
    try:  # getrusage counts what the parent had when it started this process
        status = Path("/proc/self/status").read_text()
        return int(status.partition("VmHWM:")[2].split(maxsplit=1)[0]) << 10
    except (OSError, IndexError, ValueError):
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else peak << 10


def _forget_peak() -> int:
    """Let the largest memory be what it is now, where the system can; return it."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _peak()
