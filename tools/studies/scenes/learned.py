"""Learned weights against the default on optics that no formula has, or that formulas share.

Sixteen views of 36 x 48 x 36 voxels: one scene without a fault, and the same through a cloud and a
sheath that absorb, with unequal vignettes, veils, refraction and defocus. ``default`` never trains
an encoder, and ``wernet`` begins where it ends. ``times`` is the default's error over that of the
faultless scene, ``of_default`` wernet's error over the default's, and ``kept`` whether wernet kept
what it learned. CPU seconds are without intervals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from studies.common.study import Progress, Request, Tables
from studies.scenes.design import FAULTY
from studies.scenes.exposure import TWELVE_BIT
from studies.scenes.recipe import FIRST_LARGE, SEEDS, Recipe
from studies.scenes.trial import Row, Trials

RIG = "two-level-16"
OPTICS = {
    "": 0, "cloud": 1, "sheath": 0, "unequal vignettes": 2, "veils": 1, "refraction": 1,
    "defocus": 1,
}  # fmt: skip
"""The faults, and which of its sizes each has. Most of a sheath is one factor: the smallest."""

METHODS: Mapping[str, Mapping[str, Any]] = {
    "default": {},
    "wernet": {"method": "wernet"},
    "mlem": {"method": "mlem"},
}
ERRORS = "nrmse", "cosine_distance"


def run(request: Request) -> Tables:
    """Return the benchmark's part: the half that rules are settled on, in one process."""
    with TemporaryDirectory() as folder:
        trials = Trials(Path(folder) / "scenes", Path(folder) / "rows", processes=1)
        quick = request.size != "full"
        return learned(trials, "settle", quick=quick, progress=request.progress)


def recipes(half: str, *, quick: bool = False) -> list[Recipe]:
    """Return the scenes, the faultless one first; that and the cloud alone when ``quick``."""
    family, seed = FAULTY[half][0][1], SEEDS[half] + FIRST_LARGE + 1
    names = list(OPTICS)[: 2 if quick else None]
    where = half, family, RIG, TWELVE_BIT, seed
    return [Recipe(*where, name, OPTICS[name]) for name in names]


def learned(trials: Trials, half: str, *, quick: bool, progress: Progress) -> Tables:
    """Return the errors of all methods on each scene, and their seconds: see `METHODS`."""
    scenes, found = recipes(half, quick=quick), {}
    for name, how in METHODS.items():
        options = {"uncertainty": 0, **trials.options, **how}
        found[name] = replace(trials, options=options).run(scenes, progress)
    tables = {key: [_errors(found, key, n) for n in range(len(scenes))] for key in ERRORS}
    return tables | {"cpu_seconds": [_row(found, "cpu_seconds", n) for n in range(len(scenes))]}


def _row(found: Mapping[str, list[Row]], key: str, number: int) -> Row:
    """Return what every method has under ``key`` on one scene."""
    optics = found["default"][number]["fault"] or "faultless"
    return {"optics": optics} | {name: rows[number][key] for name, rows in found.items()}


def _errors(found: Mapping[str, list[Row]], key: str, number: int) -> Row:
    """Return the errors of one scene, and what they are over others."""
    row = _row(found, key, number)
    return row | {
        "times": row["default"] / found["default"][0][key],
        "of_default": row["wernet"] / row["default"],
        "kept": found["wernet"][number]["learned"],
    }
