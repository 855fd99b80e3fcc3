"""The files of the stress test: JSON after every area, the page and its plots beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from _results import earlier_run, write_json, write_text

from _stress.page import page
from _stress.plots import OVERALL, plots
from _stress.row import Size
from tomo.draw.figures import save_figure

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
    wanted = {"size": asdict(size)}
    return earlier_run(folder / JSON, (FORMAT, VERSION), wanted, done="areas", of="a stress test")


def save(folder: Path, result: Mapping[str, Any], area: str) -> None:
    """Write the JSON, the plots and the page of what there is so far; ``area`` is new.

    The curves of other areas are drawn where they are not there yet.
    """
    write_json(folder / JSON, result, indent=1)
    names: dict[str, list[str]] = {}
    for whose, drawings in plots(result["areas"]).items():
        for name, draw in drawings.items():
            path = folder / PLOTS / f"{name}.png"
            if whose in (area, OVERALL) or not path.exists():
                save_figure(draw(), path)
            names.setdefault(whose, []).append(f"{PLOTS}/{path.name}")
    write_text(folder / PAGE, page(result, names))
