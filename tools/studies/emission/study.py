"""The command: a row a scene and method into one JSON, with the tables and curves of them all."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from functools import cache as once
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigs.files.text import plain, write_json, write_text
from rigs.progress import progress_of
from studies.common.axes import curves
from studies.common.fingerprint import commit
from studies.common.page import markdown, sections
from studies.common.processes import MOST, at_work
from studies.common.results import fresh_run, kept_run, load
from studies.common.study import Request, Tables, check_known
from studies.emission import archive as archives
from studies.emission.methods import METHODS, ours
from studies.emission.scenes import GRID, QUICK, SCENES, TINY_GRID, VERSION, seen
from studies.scenes.scene import warm_up
from tomo import VoxelGrid
from tomo.cli.console import bad_input_in_one_line, print_json, say
from tomo.cli.inputs import check_output_file, check_output_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]

BASELINE = "auto"
MARKS = ("*", "^", "s", "P", "X")
"""Signs of the methods that choose their own end, in the order of `METHODS`."""


def tables_of(rows: Sequence[Row]) -> Tables:
    """Return means by method, and the nearest of each scene."""
    by_scene: dict[str, dict[str, Row]] = {}
    for name in SCENES:
        own = {row["method"]: row for row in rows if row["scene"] == name}
        if own:
            by_scene[name] = own
    return {
        "methods": [
            _means(m, by_scene) for m in METHODS if any(m in o for o in by_scene.values())
        ],
        "nearest": [_nearest(name, own) for name, own in by_scene.items() if BASELINE in own],
    }


def _means(method: str, by_scene: Mapping[str, Mapping[str, Row]]) -> Row:
    """Return what a method came to over its scenes, and against the default on those."""
    own = [scene[method] for scene in by_scene.values() if method in scene]
    both = [s for s in by_scene.values() if method in s and BASELINE in s]
    ratios = [s[method]["nrmse"] / s[BASELINE]["nrmse"] for s in both]
    return {
        "method": method,
        "tuned_by_truth": not METHODS[method].is_ours,
        "scenes": len(own),
        "nrmse_of_auto": statistics.geometric_mean(ratios) if ratios else None,
        "nearer_than_auto": sum(ratio < 1 for ratio in ratios),
        "ssim": statistics.fmean(row["ssim"] for row in own),
        "held_out_psnr": statistics.fmean(row["held_out_psnr"] for row in own),
        "cpu_seconds": statistics.median(row["cpu_seconds"] for row in own),
        "tuning_seconds": statistics.median(row["tuning_seconds"] or 0.0 for row in own),
    }


def _nearest(name: str, own: Mapping[str, Row]) -> Row:
    """Return which method is nearest to a scene's truth, and how far the default is from it."""
    best = min(own.values(), key=lambda row: row["nrmse"])
    return {
        "scene": name,
        "family": SCENES[name].family,
        "rig": SCENES[name].rig,
        "nearest": best["method"],
        "its_nrmse": best["nrmse"],
        "auto_nrmse": own[BASELINE]["nrmse"],
        "auto_of_nearest": own[BASELINE]["nrmse"] / best["nrmse"],
        "its_seconds": best["cpu_seconds"],
        "auto_seconds": own[BASELINE]["cpu_seconds"],
    }


def figure_of(by_scene: Mapping[str, Mapping[str, list]]) -> Figure:
    """Draw a panel a scene: the least error that each method had by a run time."""
    panels = {
        name: {m: by_scene[name][m] for m in METHODS if m in by_scene[name]}
        for name in SCENES
        if name in by_scene
    }
    marks = dict(zip((m for m in METHODS if METHODS[m].is_ours), MARKS, strict=True))
    return curves(panels, "CPU seconds, one thread", "NRMSE", most_abreast=3, marks=marks)


PART = "scenes"
SIZES = {"full": (GRID, tuple(SCENES)), "quick": (GRID, QUICK), "tiny": (TINY_GRID, QUICK[:1])}
MOST_POINTS = 24  # points of a curve that are kept


def run(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")] = Path(
        "out/emission"
    ),
    scene: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A scene; repeatable. All if absent.")
    ] = None,
    method: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help=f"{', '.join(METHODS)}; repeatable.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Three scenes.")] = False,
    tiny: Annotated[bool, typer.Option("--tiny", help="One scene of few voxels.")] = False,
    archive: Annotated[
        Path | None,
        typer.Option(help="Run nothing; write images, rigs and truths of all scenes: FILE.zip."),
    ] = None,
    score: Annotated[
        Path | None,
        typer.Option(help="Run nothing; print the errors of a folder's volumes SCENE.npy."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the tables.")] = False,
) -> None:
    """Chart error against run time on twelve known emissions.

    Rows are kept in OUT/emission.json as they are done; the same command goes on with the others.
    """
    size = "tiny" if tiny else "quick" if quick else "full"
    grid, names = SIZES[size]
    with bad_input_in_one_line():
        check_known("--scene", scene or (), names)
        check_known("--method", method or (), METHODS)
        names, cache = tuple(scene or names), out / "scenes"
        check_output_folder(out)
        if archive is not None:
            check_output_file(archive, (".zip",))
            archives.write_archive(archive, names, cache, grid)
            return say(str(archive))
        if score is not None:
            tables = {"scores": archives.scored(score, names, cache, grid)}
        else:
            result = kept_run(out / "emission.json", _fresh(size))
            missing = [
                (one, each) for each in method or METHODS for one in names
                if not any((r["scene"], r["method"]) == (one, each) for r in _rows(result))
                and METHODS[each].applies(SCENES[one])
            ]  # fmt: skip
            measure(result, missing, out, cache, grid)
            tables = result["parts"][PART]["tables"]
    if json:
        print_json(tables)
    elif score is not None:
        typer.echo(markdown(tables["scores"]))


def measure(
    result: dict[str, Any],
    missing: Sequence[tuple[str, str]],
    out: Path,
    cache: Path,
    grid: VoxelGrid,
) -> None:
    """Add rows to a result, each written with its tables as it is done."""
    jobs = {one: (*one, cache, grid) for one in missing}
    with progress_of(True, PART) as progress:
        for done, (key, row) in enumerate(at_work(measured, jobs, MOST)):
            progress(done + 1, len(jobs), " ".join(key))
            if "left_out" in row:
                say(f"{key[1]}: left out: {row['left_out']}")
                continue
            result["curves"].setdefault(key[0], {})[key[1]] = plain(row.pop("curve"), digits=4)
            result["parts"][PART]["tables"]["rows"].append(plain(row, digits=5))
            write(result, out)
    if _rows(result):
        from tomo.draw.figures import save_figure

        save_figure(figure_of(result["curves"]), out / "emission" / "curves.png")


def measured(name: str, method: str, cache: Path, grid: VoxelGrid) -> dict[str, Any]:
    """Return the row of a scene and a method, with its curve."""
    scene = seen(SCENES[name], cache, grid)
    try:
        _warm(method)
        found = METHODS[method].run(scene)
    except ImportError as error:
        return {"left_out": str(error)}
    curve = found.curve or [(found.cpu_seconds, scene.scores(found.volume)["nrmse"])]
    return {
        "scene": name,
        "method": method,
        **scene.scores(found.volume),
        "cpu_seconds": found.cpu_seconds,
        "wall_seconds": found.wall_seconds,
        "tuning_seconds": found.tuning_seconds,
        "settings": {key: str(value) for key, value in found.settings.items()},
        "load": load(),
        "commit": commit(),
        "curve": curve[:: max(1, len(curve) // MOST_POINTS)] + curve[-1:],
    }


def write(result: Mapping[str, Any], out: Path) -> None:
    """Write the JSON, and the page of the tables made of its rows."""
    part = result["parts"][PART]
    order = list(METHODS), list(SCENES)
    key = lambda row: (order[0].index(row["method"]), order[1].index(row["scene"]))  # noqa: E731
    rows = sorted(part["tables"]["rows"], key=key)
    part["tables"] = {"rows": rows, **plain(tables_of(rows), digits=5)}
    write_json(out / "emission.json", result, indent=1)
    shown = {name: table for name, table in part["tables"].items() if name != "rows"}
    lines = ["# Error against run time", *sections(shown)]
    write_text(out / "emission.md", "\n".join(lines) + "\n")


@once
def _warm(method: str) -> None:
    """Load libraries and kernels, once a process and method: seconds are without."""
    warm_up()
    tiny = seen(SCENES[QUICK[0]], None, TINY_GRID)
    if METHODS[method].is_ours:
        ours(method, tiny, iterations=1)
    elif method.startswith("rtk"):
        METHODS[method].run(tiny)


def _fresh(size: str) -> dict[str, Any]:
    """Return the result of no row yet."""
    command = "python tools/emission.py" + ("" if size == "full" else f" --{size}")
    part = {"load_at_start": load(), "command": command}
    result = fresh_run("emission", VERSION, Request(size)) | {"curves": {}}
    return result | {"parts": {PART: part | {"tables": {"rows": []}}}}


def _rows(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    return result["parts"][PART]["tables"]["rows"]
