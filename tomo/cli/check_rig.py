"""``flametomo check-rig``: is a rig good enough for a volume, where not, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tomo.cli.console import print_json, say
from tomo.cli.inputs import Box, check_output_pictures, load_rig_and_grid
from tomo.pipeline.declared import number, whole

if TYPE_CHECKING:
    from rich.table import Table

    from rigs import Rig
    from rigs.check.result import RigCheck
    from tomo.grid.voxel_grid import VoxelGrid
    from tomo.operators.memory import MemoryNeed
    from tomo.operators.timing import Effort
    from tomo.pipeline.limits import Limits

EXAMPLES = """
flametomo check-rig rig.yaml
flametomo check-rig paper33_pitch --grid 30x140x30 --spacing 0.5
    -o coverage.html
"""


def check_rig(
    rig: str,
    /,
    *,
    pixel_accuracy: Annotated[float | None, number(above=0, optional=True)] = None,
    iterations: Annotated[int, whole(0)] = 100,
    time: bool = True,
    out: Sequence[Path] | None = None,
    noise: float | None = None,
    images: Path | None = None,
    pattern: str | None = None,
    json: bool = False,
    box: Box,
) -> None:
    """Check whether a rig is good enough for a volume.

    Prints a table of the cameras, what is wrong and which camera is responsible, and the memory
    and time of a reconstruction. The exit code is 0 however bad the rig is, and 2 for bad input.

    Parameters
    ----------
    pixel_accuracy : X
        RMS error of a line of sight in pixels, for cameras without a calibration; 0.2 is assumed
        where it is not given.
    iterations : N
        Iterations to estimate the time of.
    time :
        Estimate time on this machine.
    out : FILE
        A .png, .pdf, .svg, .html or .glb file for maps; repeatable.
    noise : X
        Noise of a pixel as a fraction of the brightest, such as 0.01: says how small a fault of
        each camera the images of a flame of the box's size would tell.
    images : FOLDER
        A scan or a folder of images to show in the page.
    """
    out = out or []
    check_output_pictures(out)
    if images is not None and not any(path.suffix.lower() == ".html" for path in out):
        raise ValueError(f"--images: found {images} without a page, expected an .html among --out")
    if pattern is not None and images is None:
        raise ValueError("--pattern: expected --images with it")
    if noise is not None and not 0 < noise < 1:
        raise ValueError(f"--noise: found {noise:g}, expected a fraction between 0 and 1")
    from rigs import check_rig as check_volume
    from tomo.draw import visualize_check

    loaded, default = load_rig_and_grid(rig)
    if not len(loaded):
        raise ValueError(f"{rig}: cameras: found none, expected at least one")
    is_free = default is None and not box.is_placed
    try:
        voxels = box.voxels(default)
    except ValueError as error:
        is_asked = is_free and (box.grid is None or box.spacing is None)
        raise ValueError(f"{error}{_offered_center(loaded) if is_asked else ''}") from None
    check = check_volume(loaded, voxels, pixel_accuracy=pixel_accuracy)
    if is_free:
        check = _with_offered_center(check, loaded, voxels)
    need, effort, why = _effort(loaded, voxels, time)
    limits = None if noise is None else _limits(loaded, voxels, noise)
    heading = Path(rig).stem
    pictures = None
    if images is not None:
        from tomo.draw.rig.thumbnails import load_thumbnails

        pictures = load_thumbnails(loaded, images, pattern=pattern, note=say)
    for path in out:
        visualize_check(path, check, images=pictures, title=heading)
    if not json:
        from rigs.progress import console
        from tomo.draw.rig.rig_page import COARSER_IN_WORDS

        stdout = console()
        stdout.width = max(stdout.width, 110)  # piped, it would be 80
        stdout.print(_table(check))
        stdout.print(f"{COARSER_IN_WORDS}\n", highlight=False)
        if limits is not None:
            stdout.print(_limits_table(limits))
            stdout.print(f"{limits.sentence}\n", highlight=False)
    for finding in check.findings:
        _say_finding(finding.level, finding.cameras, finding.text)
    say(f"{heading}: {check.assessment}. {_costs(need, effort, iterations, why)}", "bold")
    if json:
        report = _report(check, need, effort, iterations, why, out)
        print_json(report | ({} if limits is None else {"detection_limits": limits.report()}))


def _offered_center(rig: Rig) -> str:
    """Return the centre to ask for, in words; nothing where the cameras' axes do not meet."""
    from rigs import point_in_view

    point = point_in_view(rig)
    return "" if point is None else f"; the cameras' axes meet at --center {_triple(point)}"


def _with_offered_center(check: RigCheck, rig: Rig, grid: VoxelGrid) -> RigCheck:
    """Return the check with a line on the grid's centre, the origin as none was given."""
    import numpy as np

    from rigs import point_in_view
    from rigs.check.result import Finding

    point = point_in_view(rig)
    if point is None or np.abs(point - grid.center).max() < max(grid.spacing):
        return check
    is_outside = ((point < grid.lower) | (point > grid.upper)).any()
    finding = Finding(
        "warning" if is_outside else "note",
        "no --center was given and the rig has no volume, so the grid is about the origin; the "
        f"cameras' axes meet at {_triple(point)}: try --center {_triple(point)}",
        (),
    )
    return replace(check, findings=(finding, *check.findings))


def _triple(point: Sequence[float]) -> str:
    return ",".join(f"{value:.6g}" for value in point)


def _limits(rig: Rig, voxels: VoxelGrid, noise: float) -> Limits:
    """Return how small a fault of each camera would be noticed."""
    from tomo.operators import TRANSPARENT
    from tomo.pipeline.coarse import factor_of
    from tomo.pipeline.infer import effects_of
    from tomo.pipeline.limits import limits_of_rig
    from tomo.pipeline.options import Options

    factor = factor_of(rig, voxels)
    effects = effects_of(Options(), TRANSPARENT, voxels, factor, len(rig))
    return limits_of_rig(rig, voxels, effects, noise)


def _limits_table(limits: Limits) -> Table:
    """Return a row for each camera: the smallest faults that images would tell."""
    head = "camera", "shift (px)", "roll (°)", "zoom (%)", "gain (%)", "background (% of peak)"
    table = _headed(head, title="Smallest faults that images would tell")
    for one in limits.cameras:
        percent = (100 * one.zoom, 100 * one.gain, 100 * one.background)
        table.add_row(one.camera, *(f"{v:.2g}" for v in (one.shift, one.roll, *percent)))
    return table


def _effort(rig: Rig, voxels: VoxelGrid, is_timed: bool) -> tuple[MemoryNeed, Effort | None, str]:
    """Return the memory needed, the time measured, and why there is none."""
    from tomo.operators import estimate_memory
    from tomo.operators.timing import estimate_effort

    need = estimate_memory(tuple(rig), voxels)
    if not is_timed:
        return need, None, "not asked for"
    try:
        effort = estimate_effort(rig, voxels)
    except ValueError as error:  # too large, or nothing is seen: the assessment says so
        return need, None, str(error)
    return effort.need, effort, ""


def _table(check: RigCheck) -> Table:
    """Return a row of figures for each camera; the responsible cameras are coloured."""
    from tomo.draw.rig.rig_page import check_table

    content = check_table(check)
    levels: dict[str, str] = {}
    for finding in reversed(check.findings):
        levels.update(dict.fromkeys(finding.cameras, finding.level))
    table = _headed(content.head)
    for row in content.rows:
        table.add_row(
            *row, style={"fault": "red", "warning": "yellow"}.get(levels.get(row[0], ""), "")
        )
    return table


def _headed(head: Sequence[str], title: str | None = None) -> Table:
    """Return an empty table with its heads, names on the left and figures on the right."""
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0), title=title)
    for column, words in enumerate(head):
        table.add_column(words, justify="right" if column else "left", vertical="bottom")
    return table


def _say_finding(level: str, cameras: tuple[str, ...], text: str) -> None:
    from tomo.draw.rig.rig_page import some_names

    who = f"{some_names(cameras)}: " if cameras else ""
    style = {"fault": "red", "warning": "yellow", "note": ""}[level]
    say(f"{level}: {who}{text}", style)


def _costs(need: MemoryNeed, effort: Effort | None, iterations: int, why: str) -> str:
    """Return memory and time in words."""
    from rigs.check.resolved_wavelength import short

    text = f"{need.voxels:,} voxels, {need.rays:,} rays, {need.segments:,} segments, "
    text += f"about {need.nbytes / 1e9:.2g} GB"
    if effort is None:
        return text if why == "not asked for" else f"{text}; no time: {why}"
    trace, solve = effort.trace_seconds, iterations * effort.iteration_seconds
    return (
        f"{text} ({effort.form}); roughly {short(trace)} s to trace and {short(solve)} s for "
        f"{iterations} iterations, before dark voxels are left out"
    )


def _report(
    check: RigCheck,
    need: MemoryNeed,
    effort: Effort | None,
    iterations: int,
    why: str,
    out: Sequence[Path],
) -> dict:
    """Return the check as plain data, with the memory and time of a reconstruction."""
    estimate: dict = {"rays": need.rays, "segments": need.segments, "voxels": need.voxels}
    estimate |= {"bytes": need.nbytes}
    if effort is not None:
        estimate |= {
            "projector": effort.form,
            "trace_seconds": effort.trace_seconds,
            "iteration_seconds": effort.iteration_seconds,
            "seconds": effort.trace_seconds + iterations * effort.iteration_seconds,
        }
    else:
        estimate |= {"seconds": None, "reason": why}
    return check.report() | {"estimate": estimate, "files": [str(path) for path in out]}
