"""How far off a volume can be, as figures with their meaning; from report.json."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from tomo.draw.figures import raised
from tomo.pipeline.answer import HARMFUL
from tomo.pipeline.facts import expected_error, least_measured
from tomo.report.facts import advice, short_unit

_VIEW_BINS = ((0, 0), (1, 1), (2, 2), (3, 4), (5, 8), (9, 16), (17, 32), (33, math.inf))

Rows = list[tuple[str, str, str]]
"""Figures: value, name, and what they mean."""


def trust_figures(report: Mapping, length_unit: str) -> Rows:
    """Return the figures of the uncertainty and of the emission, of what a report knows."""
    condition = report.get("uncertainty") or {}
    unit = raised((report.get("emission") or {}).get("unit", ""))
    return [
        *_of_intervals(report, condition.get("intervals"), unit, length_unit),
        *_of_total(report, condition.get("intervals")),
        *_of_details(condition.get("voxels") or {}, length_unit),
        *_of_resolution(condition.get("resolution"), length_unit),
        *_of_noise(condition.get("standard_deviation")),
    ]


def _of_intervals(report: Mapping, found: Mapping | None, unit: str, length: str) -> Rows:
    error = expected_error(report)
    if not found or error is None:
        return []
    voxels = found["voxels"]
    widest = max(half for axis in found["edges"]["half_width"] for half in axis)
    noise, structure = voxels["relative_noise"], voxels["relative_structure"]
    rules = (
        "Noise rules: longer exposures and more frames help."
        if noise > structure
        else "The latter rules: more exposure does not help, more or better placed cameras do."
    )
    return [
        (
            f"{error:.1%}",
            "error to expect of a voxel",
            f"Root mean square, of a typical voxel that emits. Good: below {HARMFUL:.0%}. What no "
            "camera measures is not in it, and what is wrong with images or cameras only in part.",
        ),
        (
            f"± {voxels['relative']:.1%}",
            "90 % interval of a voxel",
            "The true value lies within it in nine of ten voxels that emit; in the middle one "
            f"it is ± {voxels['median_half_width']:.3g} {unit}.".replace(" .", ".")
            + f" Noise makes ± {noise:.1%}, missing views, smoothing and cameras that disagree "
            f"± {structure:.1%}. {rules}",
        ),
        (
            f"± {widest:.2g} {length}",
            "edges of the emission",
            "Where it begins and ends along x, y and z is known so well, or better.",
        ),
    ]


def _of_total(report: Mapping, found: Mapping | None) -> Rows:
    emission, rows = report.get("emission") or {}, []
    spread = (found or {}).get("total") or {}
    for key, name, words in (
        ("total", "total emission", "All light of the volume: its sum times the voxels' size."),
        ("power", "power", "Into all directions: 4 pi times the total."),
    ):
        if key in emission:
            value = f"{emission[key]:.4g} {short_unit(emission[f'{key}_unit'])}".strip()
            if spread.get("value", 0) > 0:
                value += f" ± {spread['half_width'] / spread['value']:.1%}"
            rows.append((value, name, words))
    return rows


def _of_details(voxels: Mapping, length: str) -> Rows:
    found = voxels.get("resolved_wavelength")
    if not found or "nine_tenths" not in found:
        return []
    return [
        (
            f"{found['half']:.2g} to {found['nine_tenths']:.2g} {length}",
            "finest details that the cameras measure",
            "Half of all details are measured down to the first size, 90 % down to the second, "
            f"flat layers across {least_measured(found)} only down to "
            f"{found['worst']:.2g} {length}. Anything finer in the picture comes from smoothness, "
            "not from the images. Good: smaller than the structures that you look for.",
        ),
        (
            f"{voxels['median_views']:g}",
            "cameras see a typical voxel that emits",
            "Four evenly spread ones are the least for a shape in three dimensions; cameras that "
            "face each other count once.",
        ),
    ]


def _of_resolution(found: Mapping | None, length: str) -> Rows:
    if not found:
        return []
    lengths, voxels = (
        " × ".join(f"{width:.2g}" for width in found[key]) for key in ("length", "voxels")
    )
    return [
        (
            f"{lengths} {length}",
            "resolution along x, y, z",
            f"A bright point comes out so wide: {voxels} voxels (full width at half of the "
            f"maximum, median of {found['spots']} points). Good: one or two voxels.",
        )
    ]


def _of_noise(found: Mapping | None) -> Rows:
    if not found or "relative" not in found:
        return [("not measured", "noise in a voxel", advice("--uncertainty 30 measures it"))]
    mapped = "" if found["mapped"] else " --uncertainty 30 draws it for every voxel."
    return [
        (
            f"{found['relative']:.1%}",
            "noise in a voxel",
            advice(
                "Standard deviation of a typical voxel that emits, by noise alone; from "
                f"{found['repeats']} repeats with new noise. It is part of the interval.{mapped}"
            ),
        )
    ]


def coverage_table(condition: Mapping | None) -> dict[str, Any] | None:
    """Return how many voxels are seen by how many views; None where it is not known."""
    if not condition:
        return None
    voxels, rows = condition["voxels"], []
    totals = [sum(voxels[key].values()) or 1 for key in ("by_views", "emitting_by_views")]
    most = max(map(int, voxels["by_views"]), default=0)
    for first, last in _VIEW_BINS:
        counts = [
            sum(count for views, count in voxels[key].items() if first <= int(views) <= last)
            for key in ("by_views", "emitting_by_views")
        ]
        if any(counts):
            last = min(last, most)
            name = str(first) if first == last else f"{first} to {last}"
            shares = zip(counts, totals, strict=True)
            rows.append((name, *(f"{n:,} ({n / total:.1%})" for n, total in shares)))
    return {"titles": ("Views", "voxels that may emit", "voxels that do"), "rows": rows}
