"""The uncertainty section of the report as words and tables, from report.json's figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

_VIEW_BINS = ((0, 0), (1, 1), (2, 2), (3, 4), (5, 8), (9, 16), (17, 32), (33, math.inf))


def condition_section(condition: Mapping | None, length_unit: str) -> dict[str, Any] | None:
    """Return the uncertainty section of the page: warnings, words and a table.

    Parameters
    ----------
    condition : mapping or None
        ``condition`` of the report, without what is None.
    length_unit : str
    """
    if not condition:
        return None
    voxels = condition["voxels"]
    warnings = list(condition.get("warnings") or ())
    views = _by_views(voxels)
    return {
        "warnings": warnings,
        "words": [
            *_of_views(voxels),
            *_of_images(condition.get("images") or {}),
            *_of_intervals(condition.get("intervals"), length_unit),
            *_of_deviations(condition.get("standard_deviation")),
            *_of_resolution(condition.get("resolution"), length_unit),
        ],
        "tables": [{"titles": ("Views", "voxels that may emit", "voxels that do"), "rows": views}],
    }


def _of_views(voxels: Mapping) -> list[str]:
    if "median_views" not in voxels:
        return ["No voxel emits."]
    words = voxels["resolved_wavelength"]["in_words"]
    return [
        f"{voxels['emitting']:,} voxels emit (above a hundredth of the brightest). The typical "
        f"one is seen by {voxels['median_views']:g} views. {words[:1].upper()}{words[1:]}."
    ]


def _of_images(images: Mapping) -> list[str]:
    if "residual" not in images:
        return []
    words = f"Images: {images['residual']:.1%} of them is not explained by the volume"
    if "noise" in images:
        words += f"; their noise is {images['noise']:.1%}"
    return [words + "."]


def _of_intervals(found: Mapping | None, length_unit: str) -> list[str]:
    if not found or "relative" not in found["voxels"]:
        return []
    voxels, total = found["voxels"], found["total"]
    share = total["half_width"] / total["value"] if total["value"] > 0 else math.inf
    widest = max(half for axis in found["edges"]["half_width"] for half in axis)
    return [
        f"{found['level']:.0%} intervals: ± {voxels['relative']:.1%} of the emission (root mean "
        f"squares over the voxels that emit), {voxels['relative_noise']:.1%} by noise and "
        f"{voxels['relative_structure']:.1%} by structure: missing views, smoothing, cameras "
        f"that disagree. ± {voxels['median_half_width']:.3g} in the middle. "
        f"Total: {total['value']:.4g} {total.get('unit', '')}".strip()
        + f" ± {share:.1%}. Edges of the emission: "
        f"± {widest:.2g} {length_unit} at most. They come from new noise, "
        f"from {found['camera_groups']} solves without a group of cameras each, "
        "from a second pass, and from what the images leave unexplained."
    ]


def _of_deviations(found: Mapping | None) -> list[str]:
    if not found or "relative" not in found:
        return ["Standard deviation: not asked for (--uncertainty 30 finds it)."]
    words = (
        f"Standard deviation: {found['relative']:.1%} of the emission (root mean squares over the "
        f"voxels that emit), {found['median']:.3g} in the middle, {found['largest']:.3g} at most; "
        f"{found['share_above_half']:.0%} of the emitting voxels deviate by more than half of "
        f"their value. By {found['repeats']} {found['method']}."
    )
    if not found["mapped"]:
        words += " Too few for single voxels: --uncertainty 30 maps them."
    else:
        words += f" Each voxel's is known to {found['scatter']:.0%}."
    return [words]


def _of_resolution(found: Mapping | None, length_unit: str) -> list[str]:
    if not found:
        return []
    voxels, lengths = (
        " x ".join(f"{width:.2g}" for width in found[key]) for key in ("voxels", "length")
    )
    worst = " x ".join(f"{width:.2g}" for width in found["widest_tenth_voxels"])
    return [
        f"Resolution along x, y, z: {voxels} voxels, {lengths} {length_unit} (medians of "
        f"{found['spots']} spots; {worst} voxels or more at the widest tenth, "
        f"{found['at_most_voxels']} stands for all above). It is the {found['method']}. What "
        "noise hides is not in it."
    ]


def _by_views(voxels: Mapping) -> list[tuple[str, str, str]]:
    """Return views, voxels that may emit and voxels that do, as text."""
    rows = []
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
            rows.append((name, *_shares(counts, totals)))
    return rows


def _shares(counts: Sequence[int], totals: Sequence[int]) -> list[str]:
    return [f"{n:,} ({n / total:.1%})" for n, total in zip(counts, totals, strict=True)]
