"""Rows as Markdown tables."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]
Column = tuple[str, Callable[[Row], str]]
"""A heading, and what stands under it."""

NOTHING = "–"
_NUMBER = NOTHING + r"|-?[\d,]+(\.\d+)?(e-?\d+)?"

TITLES = {
    "projectors": "Projectors",
    "solvers": "Solvers",
    "skipping": "Skipping",
    "basis": "Boxes or splines",
    "scaling": "Growth",
    "startup": "Start-up and first use",
    "mismatch": "Physics that solvers are not told",
    "training": "Training WERNet",
}


def table(rows: Sequence[Row], columns: Sequence[Column]) -> str:
    """Return a Markdown table; numbers stand on the right."""
    cells = [[write(row) for _, write in columns] for row in rows]
    right = [
        bool(cells) and all(_is_number(line[n]) for line in cells) for n in range(len(columns))
    ]
    lines = [
        "| " + " | ".join(heading for heading, _ in columns) + " |",
        "|" + "|".join("---:" if r else "---" for r in right) + "|",
        *("| " + " | ".join(line) + " |" for line in cells),
    ]
    return "\n".join(lines)


def number(key: str, digits: int = 3, scale: float = 1.0) -> Callable[[Row], str]:
    """Return what writes a number to some significant digits, without exponents where it can."""
    return lambda row: significant(row.get(key), digits, scale)


def words(key: str) -> Callable[[Row], str]:
    """Return what writes a value as it is."""
    return lambda row: _words(row.get(key))


def significant(value: float | None, digits: int = 3, scale: float = 1.0) -> str:
    """Return ``value * scale`` to some significant digits, with a dash for what is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    value = value if scale == 1 else value * scale
    if isinstance(value, int) or value == 0:
        return f"{value:,}" if isinstance(value, int) else "0"
    exponent = math.floor(math.log10(abs(value)))
    if exponent < -4:
        return f"{value:.{digits - 1}e}"
    return f"{value:,.{max(digits - 1 - exponent, 0)}f}"


def every_key(rows: Sequence[Row]) -> list[Column]:
    """Return a column for each key that holds numbers or words, in the order of the rows."""
    keys = {
        key: None
        for row in rows
        for key, value in row.items()
        if not isinstance(value, list | dict)
    }
    return [(key.replace("_", " "), lambda row, key=key: _value(row.get(key))) for key in keys]


def settings_in_words(settings: Mapping[str, Any]) -> str:
    """Return ``relaxation 0.3, subsets 8``."""
    return ", ".join(f"{name} {_value(value)}" for name, value in settings.items()) or NOTHING


def _value(value: Any) -> str:
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return _words(value)
    return significant(value)


def _words(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return NOTHING if value is None else str(value).replace("|", "\\|")


def _is_number(cell: str) -> bool:
    return all(re.fullmatch(_NUMBER, part.strip()) for part in cell.split("±"))
