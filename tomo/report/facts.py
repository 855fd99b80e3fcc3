"""Numbers, sentences, tables of facts and the glossary, as every report shows them."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping
from typing import Any

from tomo.draw.figures import raised
from tomo.draw.page import render
from tomo.grid import VoxelGrid
from tomo.pipeline.verdict import MEANS

LONGEST_DETAIL = 300
"""Characters; what is longer, values of many cameras, is left to report.json."""

PLACE = "<!-- glossary -->"


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
    for key, title, rows_of in (
        ("seconds", "Time (s)", _rows),
        ("quality", "Against the truth", _rows),
        ("emission", "Emission", _rows),
        ("screening", "Outlier pixels and inconsistent views", _rows),
        ("carving", "Pixels and voxels left out", _rows),
        ("depth_of_field", "Depth of field", _rows),
        ("gains", "Gains and backgrounds", _gains),
        ("detection_limits", "Smallest faults that these images would tell", _limits),
        ("learned", "Learned weights", _rows),
        ("projector", "Projector", _rows),
        ("basis", "Basis", _rows),
        ("pixel_weights", "Weights of pixels", _rows),
        ("solver", "Solver", _rows),
        ("scan", "Scan", _rows),
        ("settings", "Options", _rows),
        ("versions", "Versions", _rows),
    ):
        if report.get(key):
            tables.append((title, rows_of(report[key])))
    rest = [
        (key.replace("_", " "), in_words(report[key]))
        for key in ("method", "seed", "stop_reason", "first_use_seconds")
        if report.get(key) is not None
    ]
    return [("Run", rest), *tables] if rest else tables


def _rows(values: Mapping) -> list[tuple[str, str]]:
    lines = [(str(key).replace("_", " "), in_words(value)) for key, value in values.items()]
    return [line for line in lines if len(line[1]) <= LONGEST_DETAIL]


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
    """A sentence whose options, such as ``--spacing``, stand out and stay whole on a page."""

    def __html__(self) -> str:
        """Return the sentence as HTML, escaped: templates take it so.

        >>> Advice("Try < --spacing.").__html__()
        'Try &lt; <code>--spacing</code>.'
        """
        options = r"--[a-z][a-z-]*(?: (?:all|auto|NAME|\d+))?"
        return re.sub(options, r"<code>\g<0></code>", html.escape(self))


def advice(line: str) -> Advice:
    """Return a line of the program as `Advice`, a whole sentence."""
    return Advice(as_sentence(line))


def size_in_words(grid: VoxelGrid, length_unit: str, used: int) -> str:
    """Return what was made of what: the box, its voxels, and the cameras used."""
    size, voxels = (" × ".join(f"{n:.4g}" for n in values) for values in (grid.extent, grid.shape))
    cameras = f"{used} camera{'s' if used != 1 else ''}"
    return f"Emission in {size} {length_unit} ({voxels} voxels) from {cameras}"


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


def with_glossary(page: str) -> str:
    """Return a page with the terms that it uses in the place of its mark."""
    shown = re.sub(r"<(style|script)\b.*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL)
    text = html.unescape(shown)

    def uses(pattern: str) -> bool:
        return re.search(pattern, text, re.IGNORECASE) is not None

    return page.replace(PLACE, render("glossary.html", uses=uses).strip())
