"""What the studies' results share: plain data in JSON, and an earlier run to go on from."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rigs.files import atomic_path

Studies = Mapping[str, Sequence[Mapping[str, Any]]]
"""Rows of plain data, by the study's name."""


def plain(value: Any, digits: int | None = None) -> Any:
    """Return data as JSON takes them: lists, text for keys, None for NaN and infinity.

    Parameters
    ----------
    value : mapping, list, tuple, str, bool, number or None
        Also of numpy's kinds.
    digits : int, optional
        Significant ones that numbers keep; all when None.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(inner, digits) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner, digits) for inner in value]
    if hasattr(value, "item"):
        value = value.item()
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        return None
    return value if digits is None else float(f"{value:.{digits}g}")


def write_text(path: Path, text: str) -> None:
    """Write a file that appears whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, "utf-8")


def write_json(path: Path, value: Any, indent: int | None = None) -> None:
    """Write plain data; with ``indent`` a line for each."""
    write_text(path, json.dumps(value, indent=indent) + "\n")


def earlier_run(
    path: Path,
    format_and_version: tuple[str, int],
    wanted: Mapping[str, Any],
    *,
    done: str = "parts",
    of: str = "an earlier run",
) -> dict[str, Any]:
    """Return what a run left, to go on from it; an empty mapping where there is nothing.

    Parameters
    ----------
    path : Path
        Its JSON.
    format_and_version : (str, int)
        Under ``format`` and ``version``.
    wanted : mapping
        What else has to be there and the same, as ``{"size": "full", "machine": {"cores": 2}}``.
    done : str
        Under which what it did stands by name.
    of : str
        What it has to be the result of, for the message.

    Raises
    ------
    ValueError
        If it is another kind of result, or differs from what is wanted.
    """
    if not path.is_file():
        return {}
    try:
        result = json.loads(path.read_text("utf-8"))
        known = (result["format"], result["version"]) == format_and_version
        known = known and isinstance(result[done], dict)
        differing = list(_differing(result, wanted))
    except (ValueError, KeyError, TypeError):
        known = False
    if not known:
        kind = " ".join(map(str, format_and_version))
        raise ValueError(f"{path}: expected the result of {of}, {kind}")
    for key, found, value in differing:
        raise ValueError(f"{path}: --resume: {key}: found {found!r}, expected {value!r}")
    return result


def studies_of(parts: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the studies of all parts by name."""
    return {name: rows for part in parts.values() for name, rows in part["studies"].items()}


def judged(
    studies: Studies, judges: Sequence[tuple[Sequence[str], Callable[..., Iterator[Any]]]]
) -> list[dict[str, Any]]:
    """Return as plain data the claims that the studies at hand say something about.

    Parameters
    ----------
    studies : mapping
    judges : sequence of (names, callable)
        Takes the rows of the studies named, where all are there, and yields claims, which have a
        method ``row``.
    """
    found: list[Any] = []
    for names, judge in judges:
        if all(studies.get(name) for name in names):
            found += judge(*(studies[name] for name in names))
    return [claim.row() for claim in found]


def _differing(
    found: Mapping[str, Any], wanted: Mapping[str, Any]
) -> Iterator[tuple[str, Any, Any]]:
    for key, value in wanted.items():
        if isinstance(value, Mapping):
            yield from _differing(found[key], value)
        elif found[key] != value:
            yield key, found[key], value
