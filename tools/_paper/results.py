"""The files of the paper's experiments: JSON after every part, page and plots beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from _paper.claims import claims
from _paper.page import page
from _paper.plots import plots
from _paper.sizes import Sizes
from tomo.io.atomic import atomic_path
from tomo.view.figures import save_figure

FORMAT, VERSION = "wernet-paper-experiments", 1
PAGE, FOLDER, JSON = "paper.md", "paper", "paper/paper.json"
_DIGITS = 5


def load(folder: Path, size: str) -> dict[str, Any]:
    """Return what a run left, to go on from it; an empty mapping where there is nothing.

    Raises
    ------
    ValueError
        If it is no run of these experiments, or was of another size.
    """
    path = folder / JSON
    if not path.is_file():
        return {}
    try:
        result = json.loads(path.read_text("utf-8"))
        known = (result["format"], result["version"]) == (FORMAT, VERSION)
        found, _ = result["size"], result["parts"]
    except (ValueError, KeyError, TypeError):
        known = False
    if not known:
        raise ValueError(f"{path}: expected the result of an earlier run, {FORMAT} {VERSION}")
    if found != size:
        raise ValueError(f"{path}: --resume: size: found {found!r}, expected {size!r}")
    return result


def save(
    folder: Path, result: Mapping[str, Any], sizes: Sizes, fresh: Collection[str] | None = None
) -> dict[str, Any]:
    """Write the JSON, the page and the figures of what there is so far; return it with claims.

    Parameters
    ----------
    folder : Path
    result : mapping
    sizes : Sizes
    fresh : collection of str, optional
        The parts whose figures are to be drawn, the others' being there already; all when None.
    """
    studies = {
        name: rows for part in result["parts"].values() for name, rows in part["studies"].items()
    }
    new = {
        name
        for part, record in result["parts"].items()
        for name in record["studies"]
        if fresh is None or part in fresh
    }
    result = _short({**result, "claims": claims(studies)})
    with atomic_path(folder / JSON) as temporary:
        temporary.write_text(json.dumps(result), "utf-8")
    names: dict[str, list[str]] = {}
    for study, figures in plots(studies, sizes).items():
        for name, draw in figures.items():
            if study in new:
                save_figure(draw(), folder / FOLDER / f"{name}.png")
            names.setdefault(study, []).append(f"{FOLDER}/{name}.png")
    with atomic_path(folder / PAGE) as temporary:
        temporary.write_text(page(result, names, sizes), "utf-8")
    return result


def _short(value: Any) -> Any:
    """Return the value as JSON takes it: lists, five digits, None for NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(key): _short(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_short(inner) for inner in value]
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
    return value.item() if hasattr(value, "item") else value
