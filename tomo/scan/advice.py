"""How a user gives a scan its corrections: in its scan.yaml, by options, or in Python."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

Values = float | Mapping[str, float]


class Way(NamedTuple):
    """One way, in the words of messages; ``{}`` is the correction, or the line that gives it."""

    place: str
    ask: str


FILE, OPTIONS, PYTHON = "scan.yaml", "options", "python"

WAYS: Mapping[str, Way] = {
    FILE: Way("scan.yaml, corrections: {}", "write into scan.yaml, in place of what is there: {}"),
    OPTIONS: Way("{}", "run with {}"),
    PYTHON: Way("scan.with_corrections({}=...)", "use {}"),
}
"""By the kind of a scan: a scan.yaml, a rig and a folder of images, or arrays."""


def correction_line(way: str, correction: str, values: Values) -> str:
    """Return what gives a correction, to three digits: a line of scan.yaml, an option, or Python.

    >>> correction_line("scan.yaml", "dark", {"cam03": 0.015712})
    'corrections: {dark: {cam03: 0.0157}}'
    """
    import yaml

    def rounded(value: float) -> float:
        return value if isinstance(value, int) else float(f"{value:.3g}")

    if isinstance(values, Mapping):
        written: Any = {name: rounded(one) for name, one in values.items()}
    else:
        written = rounded(values)
    if way == PYTHON:
        return f"scan.with_corrections({correction}={written!r})"
    if way == OPTIONS:
        if isinstance(written, dict):
            written = ",".join(f"{name}={one}" for name, one in written.items())
        return f"{option_of(correction)} {written}"
    content = {"corrections": {correction: written}}
    text = yaml.safe_dump(content, default_flow_style=True, width=math.inf, sort_keys=False)
    return text.strip()[1:-1]


def place_of(way: str, correction: str) -> str:
    """Return where a correction is given, such as ``--bit-depth``."""
    name = option_of(correction) if way == OPTIONS else correction
    return WAYS[way].place.format(name)


def option_of(correction: str) -> str:
    """Return the option of a correction."""
    return f"--{correction.replace('_', '-')}"
