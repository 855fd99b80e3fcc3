"""The output folder of a reconstruction: volumes, pictures, report.html and report.json."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from rigs import save_rig
from rigs.files import whole_folder
from tomo.draw import visualize_rig, visualize_volume
from tomo.draw.volume.given import Volume
from tomo.io import write_volume
from tomo.pipeline import Reconstruction
from tomo.pipeline.stage import as_warning
from tomo.report.about import About
from tomo.report.content import Convergence, Results
from tomo.report.pictures import draw, write_pictures
from tomo.report.report import write_report
from tomo.solvers import Solution

PICTURES = (
    "rig",
    "flame",
    "convergence",
    "difference",
    "learned",
    "intervals",
    "condition",
)

RIG_FILE = "refined_rig.yaml"
"""The rig with its refined cameras, where there are any; a scan's own is its ``rig.yaml``."""

PAGE, FIGURES = "report.html", "report.json"

FLAME, RIG = "flame.html", "rig.html"
"""Pages to turn the volume, and the cameras around it, in a whole window."""

VOLUME_FILES = ("volume.npz", "volume.vti", "volume.nrrd")

DEVIATION_FILES = ("standard_deviation.npz", "standard_deviation.vti", "standard_deviation.nrrd")
"""Beside them where the standard deviation of single voxels is known."""

INTERVAL_FILES = ("half_width.npz", "half_width.vti", "half_width.nrrd")
"""Beside them where the voxels' 90 % intervals are known."""


def write_outcome(
    folder: str | os.PathLike,
    outcome: Reconstruction,
    *,
    with_pictures: bool = True,
    command: str = "",
) -> dict[str, Any]:
    """Write everything about a reconstruction into a folder; return what is in ``report.json``.

    Until all is written, the folder keeps what stood there before: see `rigs.files.whole_folder`.
    ``report.json`` comes last: where it stands, the rest is complete and of the same run. Where
    cameras were refined, ``refined_rig.yaml`` is the rig with them; where the standard deviation
    of single voxels is known, ``standard_deviation.npz``, ``.vti`` and ``.nrrd`` hold it, and
    ``half_width.*`` the half-widths of 90 % intervals. Pictures, rig and these volumes of an
    earlier outcome that this one does not have are removed. The report's ``warnings`` name the
    pictures that could not be drawn. No picture is drawn where ``with_pictures`` is False, and the
    page has none. The page names the ``command`` that was given.
    """
    found, report = outcome.solution, outcome.report()
    length, unit = outcome.rig.length_unit, outcome.value_unit
    others = (
        RIG_FILE,
        FLAME,
        RIG,
        *DEVIATION_FILES,
        *INTERVAL_FILES,
        *(f"{name}.png" for name in PICTURES),
    )
    with whole_folder(folder, last=(PAGE, FIGURES), others=others) as staging:
        for name in VOLUME_FILES:
            path = staging / name
            volume = outcome.volume
            write_volume(path, volume, found.grid, length, value_unit=unit, allow_nan=True)
        results = results_of(outcome)
        for names, volume in (
            (DEVIATION_FILES, results.deviation),
            (INTERVAL_FILES, results.half_width),
        ):
            for name in names if volume is not None else ():
                path = staging / name
                write_volume(path, volume, found.grid, length, value_unit=unit)
        pictures = draw(results, report["warnings"]) if with_pictures else ()
        write_pictures(staging, pictures)
        if with_pictures:
            with as_warning("flame.html, rig.html: not drawn", report["warnings"]):
                _write_pages(staging, results)
        files = sorted([*(path.name for path in staging.iterdir()), FIGURES])
        about = About(Path(folder), command, files)
        write_report(staging / PAGE, report, results, pictures, about)
        if outcome.refined_rig is not None:
            save_rig(outcome.refined_rig, staging / RIG_FILE)
        text = json.dumps(report, indent=2, allow_nan=False) + "\n"
        (staging / FIGURES).write_text(text, "utf-8")
    return report


def _write_pages(folder: Path, results: Results) -> None:
    """Write the pages that show the volume, and the rig around it."""
    unit = results.rig.length_unit
    volume = Volume(results.volume, results.grid, unit, results.value_unit)
    visualize_volume(folder / FLAME, volume, title="Reconstructed volume")
    if len(results.rig):
        visualize_rig(
            folder / RIG, results.rig, volume=volume, coverage=False, title="Cameras and volume"
        )


def results_of(outcome: Reconstruction) -> Results:
    """Return what the figures show of a whole reconstruction."""
    found = outcome.solution
    return Results(
        rig=outcome.rig,
        grid=found.grid,
        volume=found.volume,
        views=outcome.views,
        history=[_convergence(one) for one in (found, *outcome.comparisons)],
        truth=outcome.truth,
        comparisons=[(other.settings["method"], other.volume) for other in outcome.comparisons],
        method=found.settings["method"],
        learned=outcome.learned,
        value_unit=outcome.value_unit,
        deviation=outcome.standard_deviation,
        half_width=outcome.half_width,
    )


def _convergence(found: Solution) -> Convergence:
    distances = [entry.distance for entry in found.history]
    return Convergence(
        label=found.settings["method"],
        iterations=[entry.index for entry in found.history],
        relative_residual=[entry.relative_residual for entry in found.history],
        seconds=[entry.seconds for entry in found.history],
        cosine_distance=None if None in distances else distances,
    )
