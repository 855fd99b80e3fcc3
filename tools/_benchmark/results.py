"""The benchmark's files: results as JSON, written after every part; page and plots beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from _results import earlier_run, plain, studies_of, write_json, write_text

from _benchmark.claims import claims
from _benchmark.page import page
from _benchmark.plots import plots
from tomo.draw.figures import save_figure

FORMAT, VERSION = "emission-benchmark", 1
JSON, PAGE, PLOTS = "benchmark.json", "benchmark.md", "benchmark"


def load(folder: Path, size: str, machine: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a run left, to go on from it; an empty mapping where there is nothing.

    Raises
    ------
    ValueError
        If it is no benchmark's, or was of another size or on another machine.
    """
    wanted = {"size": size, "machine": {key: machine[key] for key in ("cpu", "cores")}}
    return earlier_run(folder / JSON, (FORMAT, VERSION), wanted, of="a benchmark")


def keep(
    folder: Path, result: Mapping[str, Any], part: str, rows: Sequence[Mapping[str, Any]]
) -> None:
    """Write the rows of a part that is under way, for a run that goes on; the JSON alone."""
    begun = {**result["begun"], part: rows}
    write_json(folder / JSON, plain({**result, "begun": begun}))


def save(folder: Path, result: Mapping[str, Any]) -> dict[str, Any]:
    """Write the JSON, the page and the plots of what there is so far; return it with claims."""
    studies = studies_of(result["parts"])
    result = plain({**result, "claims": claims(studies)})
    write_json(folder / JSON, result)
    names: dict[str, list[str]] = {}
    for study, figures in plots(studies).items():
        for name, figure in figures.items():
            save_figure(figure, folder / PLOTS / f"{name}.png")
            names.setdefault(study, []).append(f"{PLOTS}/{name}.png")
    write_text(folder / PAGE, page(result, names))
    return result
