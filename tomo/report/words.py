"""Sentences of pages: lines of the program as a reader meets them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from tomo.pipeline.verdict import MEANS

if TYPE_CHECKING:
    from markupsafe import Markup


def as_sentence(line: str) -> str:
    """Return a line with a capital and a full stop; empty where it is.

    >>> as_sentence("few directions: x is a guess")
    'Few directions: x is a guess.'
    """
    line = line.strip()
    end = "" if not line or line.endswith((".", "!", "?")) else "."
    return f"{line[:1].upper()}{line[1:]}{end}"


def advice(line: str) -> Markup:
    """Return a line as a sentence whose options, such as ``--spacing``, stand out and stay whole.

    >>> str(advice("try < --spacing"))
    'Try &lt; <code>--spacing</code>.'
    """
    from markupsafe import Markup, escape

    options = r"--[a-z][a-z-]*(?: (?:all|auto|NAME|\d+))?"
    return Markup(re.sub(options, r"<code>\g<0></code>", str(escape(as_sentence(line)))))


def verdict_part(verdict: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return a report's ``verdict`` as pages show it; None where there is none."""
    if not verdict:
        return None
    return {
        "level": verdict["level"],
        "means": MEANS[verdict["level"]].capitalize(),
        "reasons": [advice(line) for line in verdict["reasons"]],
        "next": [advice(line) for line in verdict["next"]],
    }
