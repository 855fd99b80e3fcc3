"""Messages on stderr, one JSON object on stdout."""

from __future__ import annotations

import json
import math
import sys
from typing import Annotated

import typer

from rigs.progress import stderr

JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def say(line: str, style: str = "") -> None:
    """Print a line on stderr as it stands."""
    stderr().print(line, style=style, markup=False, highlight=False, soft_wrap=True)


def print_json(result: dict) -> None:
    """Print one JSON object on stdout."""
    sys.stdout.write(json.dumps(result, indent=2) + "\n")


def finite_or_none(value: float) -> float | None:
    """Return a number as JSON holds it: None for NaN and infinity."""
    return value if math.isfinite(value) else None
