"""The report of a reconstruction: one HTML page that carries its pictures and loads nothing."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence

from rigs.files.text import write_text
from tomo.draw.page import embedded, render
from tomo.metrics import cosine_distance, nrmse
from tomo.pipeline import Reconstruction
from tomo.pipeline.answer import HARMFUL
from tomo.pipeline.view import View, peak_in_words
from tomo.report.about import About, origin_rows
from tomo.report.facts import (
    advice,
    as_sentence,
    detail_tables,
    number_text,
    size_in_words,
    verdict_part,
    with_glossary,
    without_nulls,
)
from tomo.report.pictures import Picture, draw, view_pictures
from tomo.report.result_figures import method_of
from tomo.report.uncertainty_tables import coverage_table, trust_figures

_TITLES = {
    "rig": "Cameras and volume",
    "flame": "The volume",
    "convergence": "How the iterations went",
    "difference": "Volumes beside each other",
    "intervals": "Where it is uncertain",
    "condition": "What noise does to every voxel",
    "learned": "Weights learned in place of segment lengths",
}

PAGES = {
    "flame.html": "the volume in a whole window",
    "rig.html": "the cameras around it, and their lines of sight",
}

SHOWN_VIEWS = 6
"""Rows of the table of views that stand open; the others, better explained, are folded up."""


def write_report(
    path: str | os.PathLike,
    report: Mapping,
    outcome: Reconstruction,
    pictures: Sequence[Picture] | None = None,
    about: About | None = None,
    stage: Mapping | None = None,
) -> None:
    """Write the page: the volume, the verdict and the next steps first, then the figures.

    What ``report``, the contents of ``report.json``, lacks is left out. ``pictures`` are what
    `draw` gave for the outcome; drawn here when None. ``about`` is where it is written and how it
    came about; the ``stage`` is that of the volume to be turned, see `tomo.draw.stage.stage`.
    """
    report, unit = without_nulls(report), outcome.rig.length_unit
    pictures = draw(outcome) if pictures is None else pictures
    shown = dict.fromkeys(_TITLES)
    for one in pictures:
        shown[one.name] = {
            "title": _TITLES.get(one.name, one.name),
            "data": embedded(one.png),
            "width": one.width,
            "caption": one.caption,
            "alt": one.alt,
        }
    text = render(
        "report.html",
        title="Reconstruction",
        about=_about(report, outcome),
        stage=stage,
        origin=origin_rows(report, about),
        files=[name for name in (about.files if about else ()) if name not in PAGES],
        pages=[(name, words) for name, words in PAGES.items() if about and name in about.files],
        view_command=about.view_command if about else "",
        compared=view_pictures(outcome.views) if pictures else None,
        verdict=verdict_part(report.get("verdict")),
        warnings=[advice(line) for line in report.get("warnings") or ()],
        answer=(report.get("answer") or {}).get("sentence"),
        pictures=shown,
        against_truth=_against_truth(report),
        comparisons=_comparison_rows(outcome),
        held_out=_held_out(report),
        trust=trust_figures(report, unit),
        coverage=coverage_table(report.get("uncertainty")),
        views=_views(report, outcome),
        shown_views=SHOWN_VIEWS,
        refinement=_refinement(report, unit),
        run=_run(report),
        details=detail_tables(report),
    )
    write_text(path, with_glossary(text))


def _about(report: Mapping, outcome: Reconstruction) -> str:
    """Return the line below the title: what was made of what, and how large it is."""
    used = sum(view.takes_part for view in outcome.views) or len(outcome.rig)
    frame = (report.get("scan") or {}).get("frame")
    words = size_in_words(outcome.solution.grid, outcome.rig.length_unit, used)
    return words + (f", frame {str(frame).removeprefix('frame_')}." if frame else ".")


Rows = list[tuple[str, str, str]]
"""Figures: value, name, and what they mean."""


def _against_truth(report: Mapping) -> Rows:
    quality = report.get("quality") or {}
    figures = (
        ("nrmse", 3, "error (NRMSE)",
         "Root mean square of the error over that of the true volume. Good: below 0.1."),
        ("cosine_distance", 3, "cosine distance",
         "Difference in shape alone: 0 is equal up to brightness. Good: below 0.01."),
        ("total_ratio", 4, "total over the true total",
         "All light of the volume over that of the true one. Good: 1."),
    )  # fmt: skip
    return [
        (number_text(quality[key], digits), name, words)
        for key, digits, name, words in figures
        if key in quality
    ]


def _held_out(report: Mapping) -> Rows:
    rows, views = [], report.get("views") or {}
    for name, figures in (report.get("held_out") or {}).items():
        missed, peak = views.get(name, {}).get("beyond_noise"), report.get("peak")
        known, unit = (peak_in_words(peak), f" {peak['unit']}") if peak else ("", "")
        if missed is not None:
            words = (
                f"The part of its image that the volume predicts wrongly. Good: up to "
                f"{HARMFUL:.0%}; with few cameras more."
            )
            rows.append((f"{missed:.1%}", f"{name}: wrong beyond noise", words))
        if "psnr" in figures:
            below = f" below {known}" if known else ""
            words = f"Error of the prediction in decibels{below}. 30 is good, 40 very good."
            rows.append((f"{number_text(figures['psnr'])} dB", f"{name}: PSNR", words))
        if "ssim" in figures:
            words = "Likeness in structure, 1 at the most; noise in the image lowers it."
            words += f" Peak {known}." if known else ""
            rows.append((number_text(figures["ssim"]), f"{name}: SSIM", words))
        own = figures.get("fitted")
        if own and "psnr" in own:
            words = (
                f"With a gain of {number_text(own['gain'])} and a background of "
                f"{number_text(own['background'])}{unit} fitted to its image; "
                f"{own.get('beyond_noise', 0):.1%} is then wrong beyond noise."
            )
            rows.append((f"{number_text(own['psnr'])} dB", f"{name}: PSNR, level fitted", words))
    return rows


def _run(report: Mapping) -> Rows:
    """Return the figures of the computation itself."""
    seconds, rows = report.get("seconds") or {}, []
    if "method" in report:
        rows.append((str(report["method"]), "method", as_sentence(report.get("stop_reason", ""))))
    if "relative_residual" in report:
        words = "Of all images, not reproduced, noise included. Good: near the images' noise."
        rows.append((f"{report['relative_residual']:.2%}", "relative residual", words))
    if "total" in seconds:
        solve = f"{seconds['solve']:.3g} s of it to solve." if "solve" in seconds else ""
        rows.append((f"{seconds['total']:.3g} s", "time", solve))
    for key, name, words in (
        ("rays", "lines of sight", "One or more through each pixel that was used."),
        ("segments", "segments", "Parts of lines of sight inside voxels: the size of the system."),
        ("voxels", "voxels", "In the grid."),
        ("active_voxels", "active voxels", "Not proved empty by dark pixels: those solved for."),
    ):
        if key in report:
            rows.append((number_text(report[key]), name, words))
    if report.get("peak_memory_mb"):
        rows.append((f"{report['peak_memory_mb']:,.0f} MB", "peak memory", ""))
    return rows


def _views(report: Mapping, outcome: Reconstruction) -> dict:
    """Return the table of views: those that took no part, then the least explained ones first."""
    listed, columns = report.get("views") or {}, _columns(report)
    rows, marked = [], []
    for number, view in enumerate(sorted(outcome.views, key=_order)):
        figures = listed.get(view.name, {})
        residual = figures.get("relative_residual", view.relative_residual)
        lit = math.isfinite(residual)
        role = "held out" if view.held_out else "excluded" if view.excluded else ""
        values = {
            "not reproduced": f"{residual:.2%}" if lit else "dark",
            "noise": f"{view.relative_noise:.2%}" if lit else "",
            "beyond noise": f"{view.beyond_noise:.1%}" if lit else "",
            "gain": f"{figures['gain']:.3f}" if "gain" in figures else "",
        }
        name = f"{view.name} ({role})" if role else view.name
        rows.append([name, *(values[column] for column, _ in columns)])
        if role:
            marked.append(number)
    titles = ("Camera", *(column for column, _ in columns))
    return {"titles": titles, "rows": rows, "marked": marked, "columns": columns}


def _columns(report: Mapping) -> list[tuple[str, str]]:
    """Return the columns of the table of views, and what they mean."""
    columns = [
        ("not reproduced", "the part of the image that the volume does not reproduce, noise "
         "included (relative residual)"),
        ("noise", "the part that is noise; the first figure cannot fall below it"),
        ("beyond noise", f"what is left of the first without noise and without details finer than "
         f"a voxel: not explained above {HARMFUL:.0%}"),
    ]  # fmt: skip
    if any("gain" in one for one in (report.get("views") or {}).values()):
        words = "brightness of the image over that of the volume's; the cameras should agree"
        columns.append(("gain", words))
    return columns


def _order(view: View) -> tuple[bool, float]:
    """Return the place of a view in the table: what took no part, then by what is unexplained."""
    return view.takes_part, -view.beyond_noise if math.isfinite(view.beyond_noise) else 0.0


def _comparison_rows(outcome: Reconstruction) -> list[tuple[str, ...]]:
    """Return cosine distance and NRMSE of every volume, where several have a truth."""
    truth = outcome.truth
    if truth is None or not outcome.comparisons:
        return []
    rows = []
    for one in (outcome.solution, *outcome.comparisons):
        apart = (number_text(measure(one.volume, truth)) for measure in (cosine_distance, nrmse))
        rows.append((method_of(one), *apart))
    return rows


def _refinement(report: Mapping, length_unit: str) -> dict | None:
    """Return what was found of every refined camera, and what held-out rays say of it."""
    found = report.get("refinement")
    if not found:
        return None
    kept = "Used" if found["accepted"] else "Not used"
    words = (
        f"{kept}: {found['reason']} (of pixels that took no part). Shifts are those of "
        "principal points; positions and turns are along and about each camera's own axes right, "
        "down and forward; trusted to: "
        "how far the rig file may be off, moved: how far the image moved, both in pixels."
    )
    rows = [
        (
            name,
            f"{own['prior_pixels']:.2f}",
            f"{own['moved_pixels']:.2f}" if "moved_pixels" in own else "not seen",
            ", ".join(f"{pixels:+.2f}" for pixels in own.get("shift_pixels", ())),
            ", ".join(f"{length:+.3g}" for length in own["position_right_down_forward"]),
            ", ".join(f"{angle:+.3f}" for angle in own["turn_degrees"]),
            f"x {own['focal_length_ratio']:.4f}",
            f"{own['gain']:.3f}",
        )
        for name, own in found["cameras"].items()
    ]
    titles = ("Camera", "trusted to (px)", "moved (px)", "shift (px)",
              f"position ({length_unit})", "turn (degrees)", "focal length", "gain")  # fmt: skip
    return {"words": words, "titles": titles, "rows": rows}
