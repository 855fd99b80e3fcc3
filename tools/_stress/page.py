"""The page of the stress test: what does not hold first, then a table for each area."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from _benchmark.tables import Column, number, table, words

from _stress import AREAS
from _stress.plots import OVERALL

_COLUMNS: list[Column] = [
    ("stress", words("stress")),
    ("over", words("over")),
    ("found", lambda row: _with_unit(row["figure"], row["unit"])),
    ("bound", lambda row: _bound(row)),
    ("holds", words("holds")),
    ("s", number("seconds", 2)),
    ("note", words("note")),
]


def page(result: Mapping[str, Any], plots: Mapping[str, Sequence[str]]) -> str:
    """Return the page in Markdown; ``plots`` are paths of pictures for each area."""
    here, areas, size = result["machine"], result["areas"], result["size"]
    rows = [row for record in areas.values() for row in record["rows"]]
    missed = [row for row in rows if not row["holds"]]
    options = (" --quick" if size["quick"] else "") + (
        f" --seed {size['seed']}" if size["seed"] else ""
    )
    lines = [
        "# Stress test",
        "",
        f"Made by `python tools/stress.py -o docs{options}`; {here['cpu']}, {here['cores']} "
        f"cores; {_minutes(areas.values())}. Every row is the worst of its range, beside what it "
        "may be. `faults` count what must not happen: a crash, a wrong result without a word, an "
        "error that is no line.",
        "",
        f"**{len(rows) - len(missed)} of {len(rows)} rows hold.**",
        "",
        *_pictures(plots.get(OVERALL, ()), "how far each row is within its bound"),
    ]
    if missed:
        lines += ["## What does not hold", "", table(missed, _COLUMNS), ""]
    for area, record in areas.items():
        lines += [f"## {AREAS[area]}", "", table(record["rows"], _COLUMNS), ""]
        lines += _pictures(plots.get(area, ()), AREAS[area])
    return "\n".join(lines).rstrip() + "\n"


def _minutes(records: Collection[Mapping[str, Any]]) -> str:
    """Return how long the areas took, and how busy the machine was as they began."""
    told = f"{sum(record['seconds'] for record in records) / 60:.0f} minutes"
    loads = [record["load_at_start"] for record in records]
    if not loads or None in loads:  # not every system knows
        return told
    return f"{told}, the load {min(loads):.1f} to {max(loads):.1f} as areas began"


def _pictures(paths: Sequence[str], what: str) -> list[str]:
    return [line for path in paths for line in (f"![{what}]({path})", "")]


def _bound(row: Mapping[str, Any]) -> str:
    sign = "≥" if row["at_least"] else "≤"
    return f"{sign} {_with_unit(row['bound'], row['unit'])}"


def _with_unit(value: float | str, unit: str) -> str:
    return f"{_number(value)} {unit}".rstrip()


def _number(value: float | str) -> str:
    """Return three digits, or the word for what is not finite."""
    return value if isinstance(value, str) else f"{value:.3g}"
