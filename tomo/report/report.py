"""The report of a reconstruction: one HTML page that carries its pictures and loads nothing."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence

from rigs.files import atomic_path
from tomo.draw.page import embedded, render
from tomo.metrics import cosine_distance, nrmse
from tomo.pipeline.answer import MOST_TIMES, VERDICTS, verdict_of
from tomo.pipeline.view import View
from tomo.report.content import Results
from tomo.report.facts import detail_tables, number_text, without_nulls
from tomo.report.pictures import Picture, draw
from tomo.report.uncertainty_tables import condition_section

_TITLES = {
    "rig": "Cameras and volume",
    "views": "Measured and re-projected images",
    "slices": "Reconstructed volume",
    "convergence": "Convergence",
    "difference": "Comparison of volumes",
    "intervals": "90 % interval of every voxel",
    "condition": "Standard deviation of every voxel",
    "learned": "Weights learned in place of segment lengths",
}


SHOWN_VIEWS = 6
"""Rows of the table of views that stand open; the others, better explained, are folded up."""


def write_report(
    path: str | os.PathLike,
    report: Mapping,
    results: Results,
    pictures: Sequence[Picture] | None = None,
) -> None:
    """Write the page.

    Parameters
    ----------
    path : path-like
        ``report.html``.
    report : mapping
        The contents of ``report.json``; what it lacks is left out.
    results : Results
        Volumes, views and histories.
    pictures : sequence of Picture, optional
        What `draw` gave for these results; drawn here when None.
    """
    report = without_nulls(report)
    pictures = draw(results) if pictures is None else pictures
    shown = {
        picture.name: {
            "title": _TITLES.get(picture.name, picture.name),
            "data": embedded(picture.png),
            "caption": picture.caption,
            "alt": picture.alt,
        }
        for picture in pictures
    }
    text = render(
        "report.html",
        method=str(report.get("method", results.method)),
        answer=_answer(report),
        headline=_headline(report),
        warnings=list(report.get("warnings") or ()),
        pictures=shown,
        views=_view_rows(report, results),
        shown_views=SHOWN_VIEWS,
        comparisons=_comparison_rows(results),
        condition=condition_section(report.get("uncertainty"), results.rig.length_unit),
        refinement=_refinement(report, results.rig.length_unit),
        details=detail_tables(report),
    )
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _headline(report: Mapping) -> list[tuple[str, str, str]]:
    """Return the page's first figures: (value, name, what it means)."""
    quality = report.get("quality") or {}
    seconds = report.get("seconds") or {}
    held_out = report.get("held_out") or {}
    rows = []
    if "cosine_distance" in quality:
        value = number_text(quality["cosine_distance"])
        rows.append((value, "cosine distance", "from the truth; 0 is equal up to brightness"))
    if "nrmse" in quality:
        rows.append(
            (number_text(quality["nrmse"]), "NRMSE", "root mean square error over the truth's")
        )
    for key, name, unit in (("psnr", "held-out PSNR", " dB"), ("ssim", "held-out SSIM", "")):
        values = [figures[key] for figures in held_out.values() if key in figures]
        if values:
            text = number_text(sum(values) / len(values)) + unit
            rows.append((text, name, f"mean of {len(values)} view(s) never used"))
    if "relative_residual" in report:
        value = f"{report['relative_residual']:.2%}"
        rows.append((value, "relative residual", "of the re-projected images"))
    emission = report.get("emission") or {}
    for key, name, words in (
        ("total", "total emission", "the integral of the volume"),
        ("power", "power", "into all directions: 4 pi times the total"),
    ):
        if "power" in emission:  # of absolute volumes
            rows.append((f"{emission[key]:.4g} {emission[f'{key}_unit']}", name, words))
    for key, name in (("solve", "to solve"), ("total", "in total")):
        if key in seconds:
            rows.append((f"{seconds[key]:.3g} s", name, "wall time"))
    for key, name, words in (
        ("rays", "rays", "lines of sight used"),
        ("segments", "segments", "pieces of rays inside voxels"),
        ("voxels", "voxels", "in the grid"),
        ("active_voxels", "active voxels", "that can be non-zero"),
    ):
        if key in report:
            rows.append((number_text(report[key]), name, words))
    if report.get("peak_memory_mb"):
        rows.append((f"{report['peak_memory_mb']:,.0f} MB", "peak memory", "of the process"))
    return rows


def _answer(report: Mapping) -> dict[str, str] | None:
    """Return the first sentence of the page and the verdict that colours it."""
    found = report.get("answer")
    if not found:
        return None
    return {"sentence": found["sentence"], "verdict": found["verdict"].replace(" ", "-")}


def _view_rows(report: Mapping, results: Results) -> list[dict]:
    """Return one row a view: those that took no part, then the least explained ones first."""
    held_out, listed = report.get("held_out") or {}, report.get("views") or {}
    rows = []
    for view in sorted(results.views, key=_order):
        figures = {**listed.get(view.name, {}), **held_out.get(view.name, {})}
        residual = figures.get("relative_residual", view.relative_residual)
        lit = math.isfinite(residual)
        rows.append(
            {
                "name": view.name,
                "held_out": view.held_out,
                "excluded": view.excluded,
                "relative_residual": f"{residual:.2%}" if lit else "dark",
                "noise": f"{view.relative_noise:.2%}" if lit else "",
                "ratio": _times(view.residual_over_noise) if lit else "",
                "beyond": f"{view.beyond_noise:.1%}" if lit else "",
                "verdict": verdict_of(view) if view.takes_part else "",
                "bar": residual if lit else 0.0,
                "gain": f"{figures['gain']:.3f}" if "gain" in figures else "",
                **{k: number_text(figures[k]) if k in figures else "" for k in ("psnr", "ssim")},
            }
        )
    longest = max((row["bar"] for row in rows), default=0.0) or 1.0
    return [{**row, "bar": 100 * row["bar"] / longest} for row in rows]


def _order(view: View) -> tuple[bool, int, float]:
    """Return the place of a view in the table: what took no part, then by what is unexplained."""
    beyond = view.beyond_noise if math.isfinite(view.beyond_noise) else 0.0
    return view.takes_part, -VERDICTS.index(verdict_of(view)), -beyond


def _times(ratio: float) -> str:
    """Return residual over noise as text; clean images have a ratio that says nothing."""
    return f"{ratio:.1f}" if ratio <= MOST_TIMES else f"above {MOST_TIMES:.0f}"


def _comparison_rows(results: Results) -> list[tuple[str, str, str]]:
    """Return cosine distance and NRMSE of every volume, when there is a truth."""
    if results.truth is None:
        return []
    return [
        (
            label,
            number_text(cosine_distance(volume, results.truth)),
            number_text(nrmse(volume, results.truth)),
        )
        for label, volume in ((results.method, results.volume), *results.comparisons)
    ]


def _refinement(report: Mapping, length_unit: str) -> dict | None:
    """Return what was found of every refined camera, and what held-out rays say of it."""
    found = report.get("refinement")
    if not found:
        return None
    kept = "Used" if found["accepted"] else "Not used"
    words = (
        f"{kept}: {found['reason']} (relative error of rays that took no part). Positions and "
        "turns are along and about each camera's own axes right, down and forward."
    )
    titles = ("Camera", "prior (px)", "moved (px)", f"position ({length_unit})")
    rows = [
        (
            name,
            f"{own['prior_pixels']:.2f}",
            f"{own['moved_pixels']:.2f}" if "moved_pixels" in own else "not seen",
            ", ".join(f"{length:+.3g}" for length in own["position_right_down_forward"]),
            ", ".join(f"{angle:+.3f}" for angle in own["turn_degrees"]),
            f"x {own['focal_length_ratio']:.4f}",
            f"{own['gain']:.3f}",
        )
        for name, own in found["cameras"].items()
    ]
    titles += ("turn (degrees)", "focal length", "gain")
    return {"words": words, "titles": titles, "rows": rows}
