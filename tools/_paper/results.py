"""The files of the paper's experiments: JSON after every part, page and plots beside it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from _results import earlier_run, plain, studies_of, write_json, write_text

from _paper.claims import claims
from _paper.page import page
from _paper.plots import plots
from _paper.sizes import Sizes
from tomo.draw.figures import save_figure

FORMAT, VERSION = "wernet-paper-experiments", 2
PAGE, FOLDER, JSON = "paper.md", "paper", "paper/paper.json"
_DIGITS = 5


def load(folder: Path, size: str) -> dict[str, Any]:
    """Return what a run left, to go on from it; an empty mapping where there is nothing.

    Raises
    ------
    ValueError
        If it is no run of these experiments, or was of another size.
    """
    return earlier_run(folder / JSON, (FORMAT, VERSION), {"size": size})


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
    studies = studies_of(result["parts"])
    new = {
        name
        for part, record in result["parts"].items()
        for name in record["studies"]
        if fresh is None or part in fresh
    }
    result = plain({**result, "claims": claims(studies)}, _DIGITS)
    write_json(folder / JSON, result)
    names: dict[str, list[str]] = {}
    for study, figures in plots(studies, sizes).items():
        for name, draw in figures.items():
            if study in new:
                save_figure(draw(), folder / FOLDER / f"{name}.png")
            names.setdefault(study, []).append(f"{FOLDER}/{name}.png")
    write_text(folder / PAGE, page(result, names, sizes))
    return result
