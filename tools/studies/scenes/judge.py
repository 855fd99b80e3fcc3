"""Errors, verdicts and findings of the default on faultless and faulty scenes, kept as rows.

A row is one scene by the default and by the solve that corrects nothing; where no correction can
mend the fault, also by that solve without the cameras at fault. All rows are in one file, which a
later run extends. The same scenes by another tree, such as an earlier commit's: ``git worktree add
/tmp/base COMMIT``, copy this tree's ``tools/studies`` and ``tools/scenes.py`` over its own, and
run ``PYTHONPATH=/tmp/base:/tmp/base/tools python /tmp/base/tools/scenes.py --rows base.json``;
then ``python tools/scenes.py --compare base.json own.json``.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from rigs.files.text import plain, write_json
from studies.common.processes import at_work
from studies.common.study import Progress
from studies.scenes.faults import FAULTS
from studies.scenes.findings import essence, findings_of, verdict_of
from studies.scenes.recipe import VERSION, Recipe
from studies.scenes.scene import known_scene, warm_up
from tomo import Options, reconstruct

Row = dict[str, Any]

UNCORRECTED: Mapping[str, Any] = {
    "screen": False,
    "refine_cameras": ("none",),
    "align": False,
    "fit_gain": False,
    "fit_absorption": False,
    "learn": False,
    "uncertainty": 0,
}
"""Options of the solve that checks and corrects nothing, as far as a tree has them."""

CHANGED = 1e-3
"""Distance of the default's volume from the uncorrected one's, over the latter's size, from which
something was corrected."""


def uncorrected(**more: Any) -> Options:
    """Return options that switch off all that checks or corrects, and ``more``.

    Where a tree has none of `UNCORRECTED` but the intervals, the table is to be extended.
    """
    known = {field.name for field in fields(Options)}
    found = {name: value for name, value in UNCORRECTED.items() if name in known}
    if not set(found) - {"uncertainty"}:
        raise ValueError(f"options: found none of {', '.join(UNCORRECTED)}, expected some")
    return Options(**{**found, **more})


def judged(recipe: Recipe, cache: Path | None, options: Mapping[str, Any] | None = None) -> Row:
    """Return the row of one scene; an error of the toolkit is a row too."""
    scene = known_scene(recipe, cache)
    row: Row = {
        **asdict(recipe),
        "scene": recipe.name,
        "faultless": recipe.faultless.key,
        "views": recipe.views,
        "expected": scene.expected,
        "mendable": scene.mendable,
    }
    warm_up()
    bare = reconstruct(scene.scan, None, uncorrected())
    row["uncorrected"] = bare.report()["quality"]["nrmse"]
    started = time.process_time()
    try:
        outcome = reconstruct(scene.scan, None, Options(**(options or {})))
        report = outcome.report()
    except Exception as error:  # whatever it is, a user would meet it
        said = f"{type(error).__name__}: {error}"
        return row | {"error": said, "nrmse": None, "verdict": "error"}
    moved = np.linalg.norm(outcome.volume - bare.volume) / np.linalg.norm(bare.volume)
    row |= {
        "nrmse": report["quality"]["nrmse"],
        "cosine_distance": report["quality"]["cosine_distance"],
        "cpu_seconds": time.process_time() - started,
        "verdict": verdict_of(report),
        "report": essence(report),
        "corrected": bool(moved > CHANGED),
    }
    if scene.at_fault and not scene.mendable:
        rest = reconstruct(scene.scan, None, uncorrected(hold_out=scene.at_fault))
        row["without"] = rest.report()["quality"]["nrmse"]
    return row


def extend(
    path: Path,
    recipes: Sequence[Recipe],
    cache: Path,
    progress: Progress,
    *,
    processes: int = 1,
    options: Mapping[str, Any] | None = None,
    seconds: float = np.inf,
) -> dict[str, Row]:
    """Return the rows of a file, by the recipes' keys, after those that it lacks were added.

    Each is written as it is there: a run that was interrupted goes on. No scene is begun after
    ``seconds``. A file of other options, or of another version of the scenes, is refused.
    """
    how = plain({"version": VERSION, "options": dict(options or {})})
    rows = read_rows(path, how) if path.is_file() else {}
    missing = [one for one in recipes if one.key not in rows]
    jobs = {one.key: (one, cache, dict(options or {})) for one in missing}
    for done, (key, row) in enumerate(at_work(judged, jobs, processes, seconds)):
        rows[key] = _read(plain(row, digits=6))
        write_json(path, {**how, "rows": rows}, indent=1)
        progress(done + 1, len(missing), row["scene"])
    return rows


def read_rows(path: Path, how: Mapping[str, Any] | None = None) -> dict[str, Row]:
    """Return the rows of a file, by key; ``how``: version and options that it should have.

    Findings are read from their reports anew, and what names a fault is that of today's `FAULTS`:
    rows last longer than the rules that they are scored by.
    """
    kept = json.loads(path.read_text("utf-8"))
    rows = kept.pop("rows")
    if how is not None and kept != how:
        raise ValueError(f"{path}: found rows of {kept}, expected {dict(how)}")
    return {key: _read(row) for key, row in rows.items()}


def _read(row: Row) -> Row:
    """Return a row with what its report says is wrong, and with what should be said."""
    said = [list(one) for one in findings_of(row.get("report", {}))]
    fault = FAULTS.get(row["fault"])
    if fault is None:
        return row | {"findings": said}
    expected = row["expected"]
    if len(fault.names) == 1:
        expected = [[list(fault.names[0]), camera] for _, camera in expected]
    mendable = row["size"] < fault.mendable
    return row | {"findings": said, "expected": expected, "mendable": mendable}
