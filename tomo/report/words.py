"""Sentences of pages: lines of the program as a reader meets them."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from typing import Any

from tomo.draw.figures import raised
from tomo.pipeline.verdict import MEANS


def as_sentence(line: str) -> str:
    """Return a line with a capital and a full stop; empty where it is.

    >>> as_sentence("few directions: x is a guess")
    'Few directions: x is a guess.'
    """
    line = line.strip()
    end = "" if not line or line.endswith((".", "!", "?")) else "."
    return f"{line[:1].upper()}{line[1:]}{end}"


class Advice(str):
    """A sentence whose options, such as ``--spacing``, stand out and stay whole on a page.

    Templates take ``__html__`` for text that is escaped already.

    >>> Advice("Try < --spacing.").__html__()
    'Try &lt; <code>--spacing</code>.'
    """

    __slots__ = ()

    def __html__(self) -> str:
        """Return the sentence as HTML, escaped."""
        options = r"--[a-z][a-z-]*(?: (?:all|auto|NAME|\d+))?"
        return re.sub(options, r"<code>\g<0></code>", html.escape(self))


def advice(line: str) -> Advice:
    """Return a line of the program as `Advice`, a whole sentence."""
    return Advice(as_sentence(line))


def short_unit(unit: str) -> str:
    """Return a unit of a total with powers of the length put together.

    >>> short_unit("full scales per mm mm^3")
    'full scales mm²'
    """
    value, _, length = unit.rpartition(" per ")
    own, _, cubed = length.partition(" ")
    return raised(f"{value} {own}^2" if value and cubed == f"{own}^3" else unit)


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
