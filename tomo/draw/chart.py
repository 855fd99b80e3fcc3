"""Curves over time for a page: a few hundred points each, however many frames there are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WIDE, HIGH = 1000, 100
"""Units of a chart's own coordinates, about as many as its pixels."""

COLOURS = (
    "#1f6fb2", "#b3480c", "#2e7d4f", "#8a3ca5", "#a58a00", "#c2255c",
    "#0b7285", "#5f3dc4", "#66740a", "#845032", "#495057", "#d6336c",
)  # fmt: skip
"""Colours of curves that differ clearly on white; more curves repeat them."""


@dataclass(frozen=True)
class Curve:
    """One curve: points of polylines in SVG's form, one for each stretch without gaps."""

    name: str
    colour: str
    lines: tuple[str, ...]
    values: tuple[str, ...] = ()  # figures of each moment that the page shows


@dataclass(frozen=True)
class Chart:
    """Curves that share a scale; ``low`` and ``high`` are its ends."""

    title: str
    unit: str
    low: str
    high: str
    curves: tuple[Curve, ...] = ()


def chart(
    title: str,
    curves: Mapping[str, NDArray],
    *,
    unit: str = "",
    shown: Sequence[int] = (),
    from_zero: bool = False,
    colours: Mapping[str, str] | None = None,
    digits: int = 4,
) -> Chart | None:
    """Return a chart of figures over the frames ``(frames,)``; None where none is finite.

    NaN is a gap. Figures of the frames at the places ``shown`` are given as text.
    """
    curves = {name: values for name, values in curves.items() if np.isfinite(values).any()}
    if not curves:
        return None
    finite = np.concatenate([values[np.isfinite(values)] for values in curves.values()])
    low, high = float(finite.min()), float(finite.max())
    if from_zero:
        low = min(low, 0.0)
    span = (high - low) or abs(high) or 1.0

    def text(value: float) -> str:
        return f"{value:.{digits}g}" if math.isfinite(value) else "none"

    made = []
    for number, (name, values) in enumerate(curves.items()):
        colour = (colours or {}).get(name, COLOURS[number % len(COLOURS)])
        lines = polylines((np.asarray(values, np.float64) - low) / span)
        made.append(Curve(name, colour, lines, tuple(text(values[place]) for place in shown)))
    return Chart(title, unit, text(low), text(high), tuple(made))


def polylines(heights: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the polylines of heights between 0 and 1; the lowest and highest of every bin."""
    count = len(heights)
    edges = np.linspace(0, count, min(count, WIDE) + 1).round().astype(int)
    lines: list[str] = []
    points: list[str] = []
    for start, stop in itertools.pairwise(edges.tolist()):
        places = start + np.flatnonzero(np.isfinite(heights[start:stop]))
        if not len(places):
            lines, points = [*lines, " ".join(points)] if points else lines, []
            continue
        own = heights[places]
        ends = {int(places[own.argmin()]), int(places[own.argmax()])}
        points += [
            f"{WIDE * (place + 0.5) / count:.1f},{HIGH * (1 - heights[place]):.1f}"
            for place in sorted(ends)
        ]
    if points:
        lines.append(" ".join(points))
    # a stretch of one point is drawn as a short dash
    return tuple(one if " " in one else f"{one} {one}" for one in lines)
