"""The seconds and warnings of the stages, and how long those to come will take."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from rigs.progress import WHOLE, Progress, staged

UNAFFECTED = "The volume is not affected: use it without, and report this line"
"""What to do where a step after the solve fails."""


@dataclass
class Stage:
    """A stage at work: `timed` starts its clock, and warnings are collected in it."""

    warnings: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def record(self) -> Record:
        """The stage's seconds and warnings as a value."""
        return Record(self.seconds, tuple(self.warnings))


@dataclass(frozen=True)
class Record:
    """The seconds and warnings of a stage that is over."""

    seconds: float = 0.0
    warnings: tuple[str, ...] = ()

    def __add__(self, later: Record) -> Record:
        return Record(self.seconds + later.seconds, self.warnings + later.warnings)


@contextmanager
def timed() -> Iterator[Stage]:
    """Time a stage, and collect its warnings."""
    stage, began = Stage(), time.perf_counter()
    yield stage
    stage.seconds = time.perf_counter() - began


@contextmanager
def as_warning(step: str, warnings: list[str]) -> Iterator[None]:
    """Let a step after the solve, whose volume stands, fail: a line joins the warnings."""
    try:
        yield
    except Exception as error:  # hours may have gone into the volume
        reason = " ".join(str(error).split()).rstrip(".")
        if not (reason and isinstance(error, (ValueError, RuntimeError))):
            reason = f"{type(error).__name__}: {reason}".removesuffix(": ")
        warnings.append(f"{step}: {reason}. {UNAFFECTED}")


class Pace:
    """The stages of some work as they begin, with the seconds of each, reported as progress.

    Nothing is known of the whole until seconds are expected of its stages. Those to come are
    expected to take so much longer, or shorter, as those that are over did; the stage at work goes
    over from what was expected to its own pace.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self.progress = progress
        self.seconds: dict[str, float] = {}
        self.expected: dict[str, float] = {}
        self.watch: Callable[[str], None] | None = None
        self._stage, self._part = "", 0.0
        self._began = self._since = time.perf_counter()

    def stage(self, name: str) -> Progress | None:
        """Begin a stage, which ends the one before; return a callable for its progress."""
        self.end()
        self._stage = name
        if self.watch:
            self.watch(name)
        self._tell_whole()
        tell = staged(self.progress)(name)
        if tell is None:
            return None

        def told(done: int, total: int, where: str) -> None:
            self._part = max(self._part, done / total if total else 0.0)
            self._tell_whole()
            tell(done, total, where)

        return told

    def end(self) -> None:
        """End the stage at work."""
        now = time.perf_counter()
        if self._stage:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._since
        self._stage, self._since, self._part = "", now, 0.0

    def expect(self, seconds: Mapping[str, float]) -> None:
        """Set what stages will take."""
        self.expected.update(seconds)

    @property
    def spent(self) -> float:
        """The seconds since the first stage could begin."""
        return time.perf_counter() - self._began

    @property
    def left(self) -> float:
        """The seconds that are left, by what is expected."""
        over = [name for name in self.expected if name in self.seconds]
        later = [n for n in self.expected if n != self._stage and n not in self.seconds]
        known = sum(self.expected[name] for name in over)
        slower = sum(self.seconds[name] for name in over) / known if known else 1.0
        own = slower * self.expected.get(self._stage, 0.0)
        spent, part = time.perf_counter() - self._since, self._part
        own = (1 - part) * ((1 - part) * own + spent) if part else max(own - spent, 0.0)
        return own + slower * sum(self.expected[name] for name in later)

    def _tell_whole(self) -> None:
        if self.progress and self.expected:
            spent, left = self.spent, self.left
            self.progress(round(10 * spent), round(10 * (spent + left)), WHOLE)
