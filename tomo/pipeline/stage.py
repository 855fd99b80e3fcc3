"""The seconds and warnings that every stage of a reconstruction carries."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

UNAFFECTED = "The volume is not affected: use it without, and report this line"
"""What to do where a step after the solve fails."""


@dataclass
class Stage:
    """A stage at work: `timed` starts its clock, and warnings are collected in it.

    Attributes
    ----------
    warnings : list of str
        The lines that the user should read before trusting the volume.
    seconds : float
        Wall time, once the stage is over.
    """

    warnings: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def record(self) -> Record:
        """The stage's seconds and warnings as a value."""
        return Record(self.seconds, tuple(self.warnings))


@dataclass(frozen=True)
class Record:
    """The seconds and warnings of a stage that is over.

    Attributes
    ----------
    seconds : float
        Wall time.
    warnings : tuple of str
    """

    seconds: float = 0.0
    warnings: tuple[str, ...] = ()


@contextmanager
def timed() -> Iterator[Stage]:
    """Time a stage, and collect its warnings."""
    stage, began = Stage(), time.perf_counter()
    yield stage
    stage.seconds = time.perf_counter() - began


@contextmanager
def as_warning(step: str, warnings: list[str]) -> Iterator[None]:
    """Let a step fail, whatever is raised: a line about it joins the warnings.

    For steps after the solve, which only say something of the volume: it stands if they fail.
    """
    try:
        yield
    except Exception as error:  # hours may have gone into the volume
        reason = " ".join(str(error).split()).rstrip(".")
        if not (reason and isinstance(error, (ValueError, RuntimeError))):
            reason = f"{type(error).__name__}: {reason}".removesuffix(": ")
        warnings.append(f"{step}: {reason}. {UNAFFECTED}")
