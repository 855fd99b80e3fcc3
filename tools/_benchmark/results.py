"""The benchmark's files: results as JSON, written after every part; page and plots beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from _benchmark.claims import claims
from _benchmark.page import page
from _benchmark.plots import plots
from tomo.io.atomic import atomic_path
from tomo.view.figures import save_figure

FORMAT, VERSION = "emission-benchmark", 1
JSON, PAGE, PLOTS = "benchmark.json", "benchmark.md", "benchmark"


def load(folder: Path, size: str, machine: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a run left, to go on from it; an empty mapping where there is nothing.

    Raises
    ------
    ValueError
        If it is no benchmark's, or was of another size or on another machine.
    """
    path = folder / JSON
    if not path.is_file():
        return {}
    try:
        result = json.loads(path.read_text("utf-8"))
        known = (result["format"], result["version"]) == (FORMAT, VERSION)
        found = {"size": result["size"], **{k: result["machine"][k] for k in ("cpu", "cores")}}
    except (ValueError, KeyError, TypeError):
        known = False
    if not known:
        raise ValueError(f"{path}: expected the result of a benchmark, {FORMAT} {VERSION}")
    wanted = {"size": size, **{key: machine[key] for key in ("cpu", "cores")}}
    for key, value in wanted.items():
        if found[key] != value:
            raise ValueError(f"{path}: --resume: {key}: found {found[key]!r}, expected {value!r}")
    return result


def save(folder: Path, result: Mapping[str, Any]) -> dict[str, Any]:
    """Write the JSON, the page and the plots of what there is so far; return it with claims."""
    studies = {
        name: rows for part in result["parts"].values() for name, rows in part["studies"].items()
    }
    result = _finite({**result, "claims": claims(studies)})
    with atomic_path(folder / JSON) as temporary:
        temporary.write_text(json.dumps(result), "utf-8")
    names: dict[str, list[str]] = {}
    for study, figures in plots(studies).items():
        for name, figure in figures.items():
            save_figure(figure, folder / PLOTS / f"{name}.png")
            names.setdefault(study, []).append(f"{PLOTS}/{name}.png")
    with atomic_path(folder / PAGE) as temporary:
        temporary.write_text(page(result, names), "utf-8")
    return result


def _finite(value: Any) -> Any:
    """Return the value with None for NaN and infinity, which JSON lacks; tuples become lists."""
    if isinstance(value, Mapping):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value.item() if hasattr(value, "item") else value
