"""Sentences of pages: lines of the program as a reader meets them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tomo.pipeline.verdict import MEANS


def as_sentence(line: str) -> str:
    """Return a line with a capital and a full stop; empty where it is.

    >>> as_sentence("few directions: x is a guess")
    'Few directions: x is a guess.'
    """
    line = line.strip()
    end = "" if not line or line.endswith((".", "!", "?")) else "."
    return f"{line[:1].upper()}{line[1:]}{end}"


def verdict_part(verdict: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return a report's ``verdict`` as pages show it; None where there is none."""
    if not verdict:
        return None
    return {
        "level": verdict["level"],
        "means": MEANS[verdict["level"]],
        "reasons": [as_sentence(line) for line in verdict["reasons"]],
        "next": [as_sentence(line) for line in verdict["next"]],
    }
