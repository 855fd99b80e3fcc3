"""A verdict: one of three levels, its reasons, and the next steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

GREEN, AMBER, RED = LEVELS = ("green", "amber", "red")
MEANS: Mapping[str, str] = {GREEN: "use it", AMBER: "use with care", RED: "do not use"}


@dataclass(frozen=True)
class Verdict:
    """How far a volume can be trusted.

    Attributes
    ----------
    level : str
        One of `LEVELS`: ``green`` use it, ``amber`` use with care, ``red`` do not use.
    reasons : tuple of str
        In plain words, the gravest first; of a green volume what speaks for it.
    next : tuple of str
        What to do, the most useful first.
    """

    level: str
    reasons: tuple[str, ...] = ()
    next: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The level and its first reason in one sentence."""
        more = len(self.reasons) - 1
        rest = f", and {more} more reason{'s' if more > 1 else ''}" if more > 0 else ""
        if self.level == GREEN:
            rest = ""
        begin = f"{self.level.capitalize()}, {MEANS[self.level]}"
        return f"{begin}: {self.reasons[0]}{rest}." if self.reasons else f"{begin}."

    def report(self) -> dict[str, Any]:
        """Return ``report.json``'s ``verdict``."""
        return {
            "level": self.level,
            "sentence": self.sentence,
            "reasons": list(self.reasons),
            "next": list(self.next),
        }
