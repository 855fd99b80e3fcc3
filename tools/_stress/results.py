"""The files of the stress test: JSON after every area, the page and its plots beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from _stress.page import page
from _stress.plots import plots
from _stress.row import Size
from tomo.io.atomic import atomic_path
from tomo.view.figures import save_figure

FORMAT, VERSION = "emission-stress", 1
JSON, PAGE, PLOTS = "stress.json", "stress.md", "stress"


def fresh(size: Size, machine: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of no area yet."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "size": asdict(size),
        "machine": machine,
        "areas": {},
    }


def load(folder: Path, size: Size) -> dict[str, Any]:
    """Return what a run left, to go on from it; an empty mapping where there is nothing.

    Raises
    ------
    ValueError
        If it is no stress test's, or was of another size or seed.
    """
    path = folder / JSON
    if not path.is_file():
        return {}
    try:
        result = json.loads(path.read_text("utf-8"))
        known = (result["format"], result["version"]) == (FORMAT, VERSION)
        found, _ = result["size"], result["areas"]
    except (ValueError, KeyError, TypeError):
        known = False
    if not known:
        raise ValueError(f"{path}: expected the result of a stress test, {FORMAT} {VERSION}")
    if found != asdict(size):
        raise ValueError(f"{path}: --resume: size: found {found}, expected {asdict(size)}")
    return result


def save(folder: Path, result: Mapping[str, Any]) -> None:
    """Write the JSON, the plots and the page of what there is so far."""
    with atomic_path(folder / JSON) as temporary:
        temporary.write_text(json.dumps(result, indent=1) + "\n", "utf-8")
    names: dict[str, list[str]] = {}
    for area, figures in plots(result["areas"]).items():
        for name, figure in figures.items():
            save_figure(figure, folder / PLOTS / f"{name}.png")
            names.setdefault(area, []).append(f"{PLOTS}/{name}.png")
    with atomic_path(folder / PAGE) as temporary:
        temporary.write_text(page(result, names), "utf-8")
