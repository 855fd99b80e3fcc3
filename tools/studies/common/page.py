"""The page of a study: what does not hold first, then the tables and pictures of each part."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from studies.common.study import Study

Row = Mapping[str, Any]
NOTHING = "–"
_NUMBER = NOTHING + r"|-?[\d,]+(\.\d+)?(e-?\d+)?"


def page(study: Study, result: Mapping[str, Any]) -> str:
    """Return the Markdown of a study's result."""
    machine = result["machine"]
    lines = [
        f"# {study.title.rstrip('.')}",
        "",
        f"Made by `python tools/{study.name}.py`, size {result['size']}, seed {result['seed']}; "
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_gb']:.0f} GB; "
        f"Python {machine['versions']['python']}, numba {machine['versions'].get('numba', '?')}.",
    ]
    for name, record in result["parts"].items():
        title = study.parts[name][0]
        took, busy = (significant(record[key], 2) for key in ("seconds", "load_at_start"))
        lines += ["", f"## {title}", "", study.about(name)]
        lines += ["", f"`--part {name}` took {took} s; the load was {busy} at its start."]
        for picture in record["pictures"]:
            lines += ["", f"![{title}]({picture})"]
        lines += sections(record["tables"])
    return "\n".join(lines) + "\n"


def sections(tables: Mapping[str, Sequence[Row]]) -> list[str]:
    """Return the lines of tables, each below its name; none of those without rows."""
    found = []
    for name, rows in tables.items():
        if rows:
            found += ["", f"**{name.replace('_', ' ')}**", "", markdown(rows)]
    return found


def markdown(rows: Sequence[Row]) -> str:
    """Return a Markdown table of all columns that hold numbers or words."""
    scalars = {k: None for row in rows for k, value in row.items() if not isinstance(value, list)}
    columns = list(scalars)
    cells = [[cell(row.get(key)) for key in columns] for row in rows]
    right = [all(re.fullmatch(_NUMBER, line[n]) for line in cells) for n in range(len(columns))]
    return "\n".join(
        "| " + " | ".join(line) + " |"
        for line in (
            [key.replace("_", " ") for key in columns],
            ["---:" if is_number else "---" for is_number in right],
            *cells,
        )
    )


def cell(value: Any) -> str:
    """Return a value as a table shows it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {cell(inner)}" for key, inner in value.items()) or NOTHING
    if isinstance(value, str):
        return value.replace("|", "\\|")
    return significant(value)


def significant(value: float | None, digits: int = 3) -> str:
    """Return a number to some significant digits, with a dash for what is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if isinstance(value, int) or value == 0:
        return f"{value:,}" if isinstance(value, int) else "0"
    exponent = math.floor(math.log10(abs(value)))
    if exponent < -4 or exponent > 12:
        return f"{value:.{digits - 1}e}"
    return f"{value:,.{max(digits - 1 - exponent, 0)}f}"


def said(line: str) -> None:
    """Print a line at once: what comes next takes long, or the machine may be taken away."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
