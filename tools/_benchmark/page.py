"""The page of results: what was wanted, then each study's tables beside its plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

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

ABOUT: Mapping[str, tuple[str, str]] = {
    "projectors": (
        "Rates",
        "Rays that meet the grid, pixels half a voxel wide; medians of runs in turn. A ratio is "
        "that of rates, against the row named at the same size and number of threads; the stored "
        "matrix and the tracers use all threads, scipy one. Bandwidth is that of reading a large "
        "array in the same run.",
    ),
    "solvers_mean": (
        "Error and time of every method",
        "No inverse crime: images are simulated with several rays a pixel through voxels twice as "
        "fine. `auto` is the default, which chooses and stops without the truth; every other "
        "method has the settings that were best on seed 0 and is stopped where it is nearest to "
        "the truth; `art`, the baseline, skips nothing. Means over the other seeds, with their "
        "standard deviation; seconds since the images were in memory, tracing included, for "
        "`auto` choosing too.",
    ),
    "consistent": (
        "Exact data",
        "The images are the true voxels projected through the very matrix that is inverted: an "
        "inverse crime, to time the arithmetic. 33 views; seconds since the images were in "
        "memory, tracing included.",
    ),
    "skipping": (
        "Flames",
        "33 views. `auto` is the default as it stops by itself, the others are best-stopped.",
    ),
    "plume": (
        "A real plume",
        "ScalarFlow's fog: each camera predicted from the four others by the default.",
    ),
    "basis_mean": (
        "Emission even within voxels, or straight between their centres",
        "No inverse crime, and less of it than elsewhere: images are simulated through voxels "
        "four times as fine. The default, which chooses and stops without the truth, by boxes and "
        "by splines; stopped is the best of non-negative least squares (plain and smooth) and "
        "CGLS by boxes, each where it is nearest to the truth. The share is that of boxes' "
        "squared error of left-out views that splines leave: below 1 they are taken. Means over "
        "the seeds; seconds since the images were in memory, the judgement of both included for "
        "splines.",
    ),
    "scaling_edge": (
        "With the grid",
        "Images have as many pixels along their edge as the grid has voxels. Each row is a "
        "process of its own; memory is what it took at its peak beyond what it had after imports "
        "and a tiny problem, parts of which small cases use again.",
    ),
    "scaling_views": ("With views", ""),
    "threads": (
        "With threads",
        "All run in turn in one process; medians. The machine's rows hold nothing of ours: small "
        "matrices multiplied, roots that wait for each other, a large array read. Where "
        "arithmetic gains little by a second thread, what are called cores are two threads of "
        "one; where reading does, one thread reads nearly all that the memory gives.",
    ),
    "memory_target": (
        "Memory on the fly",
        "The images and two volumes are what a product and its adjoint must hold in any case.",
    ),
    "startup": (
        "Seconds",
        "With an empty cache of compiled code, and with the cache that this left.",
    ),
    "mismatch_mean": (
        "Chords against learned weights",
        "The images hold what chord lengths lack, one effect at a time or all: gains that differ "
        "by 10 %, gas that absorbs (an optical depth of 2 across the box, or of 1 through the "
        "flame for its own light), 40 % of the light lost in the corners, a blur of two voxels; "
        "pixels have an area everywhere. 33 views; no solver is told, and no gain is fitted. "
        "Classic is the best of CGLS, non-negative least squares (plain and smooth, of boxes and "
        "of splines), least squares with a penalty on relative curvature (of either), SIRT, MLEM "
        "and total variation, each stopped where it is nearest to the truth; informed is the best "
        "of the least squares and of that one, so stopped, with the true weights: about what the "
        'images allow; WERNet is `reconstruct(method="wernet")`, which stops by itself. It is '
        'asked to look for discs out of focus in the images (`blur="auto"`); beside it stands '
        "what it comes to when it is not. Means over "
        "the seeds; seconds since the images were in memory.",
    ),
    "training": (
        "Time of an epoch",
        "WERNet as its paper has it (`wernet-paper`), on the jet seen by 33 views. Padded is the "
        "paper's form: every ray as long as the longest of its step, and torch's convolutions. A "
        "form is timed in some steps of about 3200 rays, the same ones for each but for those "
        "skipped, in turn after one round that is not counted; medians, with Adam's steps and "
        "the making of the batches. An epoch is that times all its rays over those timed. "
        "Gradients are compared in the first of the steps: the largest difference of any "
        "parameter's entries, over the largest of that parameter's. Double precision says that "
        "both forms are one function; in single, as trained, each form sums in an order of its "
        "own.",
    ),
}

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
        ("live voxels", number("live_voxels")),
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
        ("live voxels", number("live_voxels")),
        ("trace (s)", number("prepare_seconds", 2)),
        ("s to 1e-3", number("seconds_to_1e3", 2)),
        ("s", number("seconds", 2)),
        ("cosine distance", number("cosine_distance")),
        ("NRMSE", number("nrmse")),
    ],
    "plume": [
        ("frame", words("frame")),
        ("held out", words("held_out")),
        ("skip", words("skip")),
        ("PSNR (dB)", number("psnr", 4)),
        ("SSIM", number("ssim")),
        ("s", number("seconds", 2)),
        ("segments (million)", number("segments", 3, 1e-6)),
        ("live voxels", number("live_voxels")),
        ("chosen", words("method")),
    ],
    "basis_mean": [
        ("flame", words("flame")),
        ("views", number("views")),
        ("noise", words("noise")),
        ("seeds", number("seeds")),
        ("share", number("share", 2)),
        ("boxes, stopped", number("stopped_cosine_distance")),
        ("boxes", number("boxes_cosine_distance")),
        ("NRMSE", number("boxes_nrmse")),
        ("s", number("boxes_seconds", 2)),
        ("splines", number("splines_cosine_distance")),
        ("NRMSE", number("splines_nrmse")),
        ("s", number("splines_seconds", 2)),
        ("splines / boxes", number("ratio", 2)),
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
