"""The page of results: what was wanted, then each study's tables beside its plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from _benchmark.page_texts import ABOUT
from _benchmark.sizes import FULL
from _benchmark.tables import (
    TITLES,
    Column,
    every_key,
    number,
    settings_in_words,
    significant,
    table,
    words,
)

_SCENE: list[Column] = [("flame", words("flame")), ("noise", words("noise"))]
_MIB = 1 / 2**20

_GROWTH: list[Column] = [
    ("form", words("form")),
    ("grid edge", number("edge")),
    ("views", number("views")),
    ("segments (million)", number("segments", 3, 1e-6)),
    ("trace (s)", number("trace_seconds")),
    ("forward (s)", number("forward_seconds")),
    ("adjoint (s)", number("adjoint_seconds")),
    ("peak (MiB)", number("peak_bytes", 3, _MIB)),
    ("images + 2 volumes (MiB)", number("needed_bytes", 3, _MIB)),
    ("left out", words("skipped")),
]

COLUMNS: Mapping[str, list[Column]] = {
    "projectors": [
        ("what", words("what")),
        ("grid edge", number("voxels")),
        ("views", number("views")),
        ("threads", number("threads")),
        ("million rays/s", number("rays_per_second", 3, 1e-6)),
        ("million crossings/s", number("crossings_per_second", 3, 1e-6)),
        ("ratio", number("ratio")),
        ("to", words("ratio_to")),
        ("GB/s", number("bytes_per_second", 3, 1e-9)),
        ("of the bandwidth", number("bandwidth_share")),
    ],
    "solvers_mean": [
        ("method", words("method")),
        ("settings", lambda row: settings_in_words(row["settings"])),
        ("cosine distance", lambda row: _mean(row, "cosine_distance")),
        ("NRMSE", lambda row: _mean(row, "nrmse")),
        ("of best ART", number("of_best_art", 2)),
        ("passes", number("best_pass", 2)),
        ("seconds", number("seconds", 2)),
    ],
    "consistent": [
        ("flame", words("flame")),
        ("method", words("method")),
        ("skip", words("skip")),
        ("segments (million)", number("segments", 3, 1e-6)),
        ("active voxels", number("active_voxels")),
        ("trace (s)", number("prepare_seconds", 2)),
        ("passes to 1e-3", number("passes_to_1e3")),
        ("s to 1e-3", number("seconds_to_1e3", 2)),
        ("s to 1e-6", number("seconds_to_1e6", 2)),
    ],
    "skipping": [
        *_SCENE,
        ("method", words("method")),
        ("skip", words("skip")),
        ("segments (million)", number("segments", 3, 1e-6)),
        ("active voxels", number("active_voxels")),
        ("trace (s)", number("prepare_seconds", 2)),
        ("s to 1e-3", number("seconds_to_1e3", 2)),
        ("s", number("seconds", 2)),
        ("cosine distance", number("cosine_distance")),
        ("NRMSE", number("nrmse")),
    ],
    "skippable": [
        ("flame", words("flame")),
        ("brighter than", number("share")),
        ("active voxels", number("active_voxels")),
        ("of", number("voxels")),
        ("segments (million)", number("segments", 3, 1e-6)),
        ("times fewer", number("fewer")),
        ("cosine distance", number("cosine_distance", 2)),
    ],
    "plume": [
        ("frame", words("frame")),
        ("held out", words("held_out")),
        ("skip", words("skip")),
        ("PSNR (dB)", number("psnr", 4)),
        ("SSIM", number("ssim")),
        ("s", number("seconds", 2)),
        ("segments (million)", number("segments", 3, 1e-6)),
        ("active voxels", number("active_voxels")),
        ("chosen", words("method")),
    ],
    "basis_mean": [
        ("flame", words("flame")),
        ("views", number("views")),
        ("noise", words("noise")),
        ("seeds", number("seeds")),
        ("share", number("share", 2)),
        ("best classic, stopped", words("stopped")),
        ("its distance", number("stopped_cosine_distance")),
        ("boxes", number("boxes_cosine_distance")),
        ("NRMSE", number("boxes_nrmse")),
        ("s", number("boxes_seconds", 2)),
        ("splines", number("splines_cosine_distance")),
        ("NRMSE", number("splines_nrmse")),
        ("s", number("splines_seconds", 2)),
        ("splines / boxes", number("ratio", 2)),
        ("splines / stopped", number("of_stopped", 3)),
    ],
    "scaling_edge": _GROWTH,
    "scaling_views": _GROWTH,
    "threads": [
        ("form", words("form")),
        ("product", words("product")),
        ("grid edge", number("edge")),
        ("views", number("views")),
        ("threads", number("threads")),
        ("s", number("seconds")),
        ("times faster than one", number("speed_up")),
    ],
    "startup": [
        ("what", words("what")),
        ("step", words("step")),
        ("nothing compiled (s)", number("empty")),
        ("from the cache (s)", number("warm")),
    ],
    "mismatch_mean": [
        ("effect", words("effect")),
        *_SCENE,
        ("seeds", number("seeds")),
        ("best classic", words("classic")),
        ("pass", number("classic_pass", 2)),
        ("its cosine distance", number("classic_cosine_distance")),
        ("NRMSE", number("classic_nrmse")),
        ("s", number("classic_seconds", 2)),
        ("informed", number("informed_cosine_distance")),
        ("WERNet's cosine distance", number("wernet_cosine_distance")),
        ("NRMSE", number("wernet_nrmse")),
        ("s", number("wernet_seconds", 2)),
        ("informed / classic", number("informed_of_classic", 2)),
        ("WERNet / classic", number("wernet_of_classic", 2)),
        ("not looking for discs / classic", number("default_of_classic", 2)),
    ],
    "training": [
        ("encoder", words("variant")),
        ("form", words("layout")),
        ("skip", words("skip")),
        ("device", words("device")),
        ("rays", number("rays")),
        ("segments (million)", number("segments", 3, 1e-6)),
        ("steps timed", number("steps")),
        ("rays timed", number("timed_rays")),
        ("s", number("seconds")),
        ("s an epoch", number("epoch_seconds")),
        ("times faster", number("times_faster")),
        ("gradients from the padded, double", number("gradient_difference", 2)),
        ("single", number("gradient_rounding", 2)),
    ],
    "memory_target": [
        *_GROWTH[1:-1],
        ("ratio", lambda row: _memory_ratio(row, "peak_bytes")),
        ("ratio after one SIRT step", lambda row: _memory_ratio(row, "solver_bytes")),
        _GROWTH[-1],
    ],
}


def page(result: Mapping[str, Any], plots: Mapping[str, Sequence[str]]) -> str:
    """Return the Markdown of a result.

    Parameters
    ----------
    result : mapping
        The contents of ``benchmark.json``.
    plots : mapping
        For each study the paths of its plots, relative to the page.
    """
    machine = result["machine"]
    loaded = machine["load_at_start"]
    lines = [
        "# Benchmark",
        "",
        f"Size {result['size']}; {machine['cpu']}, {machine['cores']} cores, "
        f"{machine['memory_gb']:.0f} GB; Python {machine['versions']['python']}, "
        f"numba {machine['versions'].get('numba', '?')}; "
        f"load {significant(loaded, 2)} at the start. All figures are of one run; what is "
        "compared ran in turn in one process. Compiled code was warmed up before: first use "
        f"took {significant(result['first_use_seconds'], 2)} s.",
        "",
        "Made by `python tools/benchmark.py`.",
    ]
    if result["claims"]:
        columns = [(key, words(key)) for key in ("what", "wanted", "found", "met")]
        lines += ["", "## What was wanted", ""]
        if result["size"] != FULL.name:
            lines += [f"The aims are for the full size; this run is {result['size']}.", ""]
        lines.append(table(result["claims"], columns))
    for part, record in result["parts"].items():
        took, busy = (significant(record[key], 2) for key in ("seconds", "load_at_start"))
        lines += ["", f"## {TITLES[part]}", "", f"Took {took} s; load {busy} at its start."]
        for note in record["notes"]:
            lines += ["", note]
        for name, rows in record["studies"].items():
            if name in ABOUT or name not in COLUMNS:
                lines += _study(name, rows, plots.get(name, ()))
    return "\n".join(lines) + "\n"


def _study(name: str, rows: Sequence[Mapping], plots: Sequence[str]) -> list[str]:
    if not rows or f"{name}_mean" in ABOUT:
        return []
    title, text = ABOUT.get(name, (name.replace("_", " "), ""))
    lines = ["", f"### {title}", *(["", text] if text else [])]
    for plot in plots:
        lines += ["", f"![{title}]({plot})"]
    if name != "solvers_mean":
        return [*lines, "", table(rows, COLUMNS.get(name) or every_key(rows))]
    scenes = {(row["flame"], row["views"], row["noise"]): [] for row in rows}
    for row in rows:
        scenes[row["flame"], row["views"], row["noise"]].append(row)
    for (flame, views, noise), mine in scenes.items():
        mine.sort(key=lambda row: row["cosine_distance"])
        seeds = mine[0]["seeds"]
        heading = f"{flame}, {views} views, {noise}, {seeds} seed{'s' if seeds > 1 else ''}"
        lines += ["", f"**{heading}**", "", table(mine, COLUMNS[name])]
    return lines


def _mean(row: Mapping, key: str) -> str:
    spread = row[f"{key}_spread"]
    text = significant(row[key])
    return f"{text} ± {significant(spread, 1)}" if row["seeds"] > 1 else text


def _memory_ratio(row: Mapping, key: str) -> str:
    return significant(row[key] / row["needed_bytes"]) if key in row else "–"
