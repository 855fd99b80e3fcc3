"""Numbers, sentences and tables of facts, as every report shows them."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping
from typing import Any

from tomo.draw.figures import raised
from tomo.pipeline.verdict import MEANS

LONGEST_DETAIL = 300
"""Characters; what is longer, values of many cameras, is left to report.json."""


def without_nulls(values: Mapping) -> dict:
    """Return ``values`` without what is None at any depth: JSON's way to say not known."""
    return {
        key: without_nulls(value) if isinstance(value, Mapping) else value
        for key, value in values.items()
        if value is not None
    }


def number_text(value: object, digits: int = 3) -> str:
    """Return a number as text: whole ones in groups of three, others with so many digits."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if not math.isfinite(value):
        return "not defined"
    if float(value).is_integer() and abs(value) >= 1:
        return f"{int(value):,}"
    return f"{value:.{digits}g}"


def detail_tables(report: Mapping) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return the tables at the end: seconds, settings, versions, and whatever else there is."""
    tables = []
    for key, title in (
        ("seconds", "Time (s)"),
        ("quality", "Against the truth"),
        ("emission", "Emission"),
        ("screening", "Outlier pixels and inconsistent views"),
        ("carving", "Pixels and voxels left out"),
        ("depth_of_field", "Depth of field"),
        ("gains", "Gains and backgrounds"),
        ("detection_limits", "Smallest faults that these images would tell"),
        ("learned", "Learned weights"),
        ("projector", "Projector"),
        ("basis", "Basis"),
        ("pixel_weights", "Weights of pixels"),
        ("solver", "Solver"),
        ("scan", "Scan"),
        ("settings", "Options"),
        ("versions", "Versions"),
    ):
        values = report.get(key)
        if key == "gains" and values:
            tables.append((title, _gains(values)))
        elif key == "detection_limits" and values:
            tables.append((title, _limits(values)))
        elif isinstance(values, Mapping) and values:
            lines = [(str(k).replace("_", " "), in_words(v)) for k, v in values.items()]
            tables.append((title, [line for line in lines if len(line[1]) <= LONGEST_DETAIL]))
    rest = [
        (key.replace("_", " "), in_words(report[key]))
        for key in ("method", "seed", "stop_reason", "first_use_seconds")
        if report.get(key) is not None
    ]
    return [("Run", rest), *tables] if rest else tables


def _gains(gains: Mapping) -> list[tuple[str, str]]:
    """Return a line for each camera: the whole gain and background that its image was rid of."""
    lines = []
    for name in gains["gain"]:
        gain, background = (
            f"{in_words(gains[key][name])} ± {_error(gains.get(f'{key}_error', {}).get(name))}"
            for key in ("gain", "offset")
        )
        lines.append((name, f"gain {gain}, background {background}"))
    return lines


def _limits(limits: Mapping) -> list[tuple[str, str]]:
    """Return a line for each camera, and what is not told apart."""
    lines = []
    for name, one in limits["cameras"].items():
        known = {key: value for key, value in one.items() if value is not None}
        units = {"shift": " px", "roll": "°"}
        said = [
            f"{key} {value:.2g}{units[key]}" if key in units else f"{key} {value:.1%}"
            for key, value in known.items()
        ]
        lines.append((name, ", ".join(said)))
    pairs = "; ".join(" with ".join(pair) for pair in limits["alike"])
    return [*lines, ("not told apart", pairs)] if pairs else lines


def _error(value: float | None) -> str:
    return "not known" if value is None or not math.isfinite(value) else number_text(value, 2)


def in_words(value: object) -> str:
    """Return a value of the report as text: what many cameras share is said once."""
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return number_text(value, 4)
    if isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        parts = [in_words(inner) for inner in value.values()]
        if len(parts) > 2 and len(set(parts)) == 1:
            return f"{parts[0]} (all {len(parts)})"
        return "; ".join(f"{k}: {part}" for k, part in zip(value, parts, strict=True)) or "none"
    if isinstance(value, list | tuple):
        nested = any(isinstance(inner, Mapping | list | tuple) for inner in value)
        return ("; " if nested else ", ").join(map(in_words, value)) or "none"
    return str(value)


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
