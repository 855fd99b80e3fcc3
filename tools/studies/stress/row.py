"""One stress: what was done, over which range, the worst that came of it, and its bound."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from studies.common.axes import Points
from studies.common.page import significant
from studies.common.study import Tables


@dataclass(frozen=True)
class Chart:
    """What a row's figure came from: curves by name, and words above and along the axes."""

    title: str
    x: str
    y: str
    curves: Mapping[str, Points]


@dataclass(frozen=True)
class Row:
    """One stress and its figure."""

    stress: str  # what was done to the toolkit
    over: str  # the range it was done over
    figure: float  # the worst that was measured; NaN where nothing came of it
    bound: float  # what it may be at most, or has to be at least
    unit: str = ""  # of both; "faults" for counts of what must not happen
    at_least: bool = False  # whether the figure has to be at least the bound
    note: str = ""  # where it was worst, or why the bound is right to fail
    chart: Chart | None = None
    # lines of plain data for other tables of the part, by the table's name
    lines: Mapping[str, Sequence[dict[str, Any]]] = field(default_factory=dict)

    @classmethod
    def of_faults(
        cls,
        stress: str,
        over: str,
        faults: Sequence[str],
        otherwise: str = "",
        unit: str = "faults",
    ) -> Self:
        """Return the row that counts what must not happen; the first five are its note."""
        note = "; ".join(list(dict.fromkeys(filter(None, faults)))[:5])
        return cls(stress, over, len(faults), 0, unit, note=note or otherwise)

    @classmethod
    def of_worst(
        cls,
        stress: str,
        over: str,
        figures: Iterable[tuple[str, float]],
        bound: float,
        unit: str = "",
        **more: Any,
    ) -> Self:
        """Return the row of the largest of named figures; its name is the note."""
        worst, where = worst_of(figures)
        return cls(stress, over, worst, bound, unit, **{"note": where} | more)

    @property
    def holds(self) -> bool:
        """Whether the figure is within its bound; NaN never is."""
        return bool(self.figure >= self.bound if self.at_least else self.figure <= self.bound)

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "stress": self.stress,
            "over": self.over,
            "found": f"{significant(float(self.figure))} {self.unit}".rstrip(),
            "bound": f"{'≥' if self.at_least else '≤'} {significant(float(self.bound))}",
            "holds": self.holds,
            "note": self.note,
            "figure": self.figure,
            "curves": self.chart,
        }


def measured(rows: Iterable[Row]) -> Tables:
    """Return the rows as a part's tables, each with the seconds it took."""
    tables: Tables = {"rows": []}
    began = time.perf_counter()
    for row in rows:
        now = time.perf_counter()
        tables["rows"].append(row.plain() | {"seconds": now - began})
        for name, lines in row.lines.items():
            tables.setdefault(name, []).extend(lines)
        began = now
    return tables


def charts(tables: Tables) -> tuple[dict[str, Mapping[str, Points]], str, str]:
    """Return the curves of a part's rows: a panel for each row that has some."""
    shown = [row["curves"] for row in tables["rows"] if row["curves"]]
    first = shown[0] if shown else Chart("", "", "", {})
    return {chart.title: chart.curves for chart in shown}, first.x, first.y


def relative_error(found: ArrayLike, expected: ArrayLike) -> float:
    """Return ``|found - expected| / |expected|`` in float64; infinite where found is not finite.

    Both are scaled by the largest expected value first: squares of 1e200 or 1e-200 must not
    overflow or vanish.
    """
    found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    if found.shape != expected.shape or not np.isfinite(found).all():
        return math.inf
    scale = np.abs(expected).max(initial=0.0)
    if scale == 0:
        return 0.0 if not found.any() else math.inf
    return float(np.linalg.norm((found - expected) / scale) / np.linalg.norm(expected / scale))


def worst_of(figures: Iterable[tuple[str, float]]) -> tuple[float, str]:
    """Return the largest of named figures and its name; NaN is worse than any number."""
    worst, where = -math.inf, ""
    for name, figure in figures:
        if math.isnan(figure) or figure > worst:
            worst, where = figure, name
        if math.isnan(figure):
            break
    return worst, where
