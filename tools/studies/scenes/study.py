"""The command that runs known scenes and writes what they came to: JSON and a page of tables."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from rigs.files import atomic_path
from rigs.files.json_file import plain, write_json
from rigs.progress import progress_of
from studies.common.machine import machine
from studies.common.page import markdown
from studies.common.study import Tables
from studies.scenes import ablation, accuracy, confusion, intervals, resolution
from studies.scenes.patches import parsed, patched
from studies.scenes.recipe import HALVES
from studies.scenes.trial import MOST_PROCESSES, Trials
from tomo import Options
from tomo.cli.console import say
from tomo.cli.errors import bad_input_in_one_line
from tomo.cli.outputs import check_output_folder
from tomo.cli.usage import command_line

PARTS: dict[str, tuple[Any, Callable[..., Tables]]] = {
    "accuracy": (accuracy, accuracy.accuracy),
    "faults": (confusion, confusion.confusion),
    "ablation": (ablation, ablation.ablation),
    "resolution": (resolution, resolution.resolution),
    "intervals": (intervals, intervals.intervals),
}


def command() -> typer.Typer:
    """Return the command line."""
    return command_line(run, "scenes", help="Run known scenes that nobody tuned on.")


def run(
    half: Annotated[str, typer.Option(help=f"The families to run: {', '.join(HALVES)}.")],
    part: Annotated[str, typer.Option(help=f"What to measure: {', '.join(PARTS)}.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")] = Path(
        "out/scenes_study"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="Fewer scenes.")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep what the folder holds of the same scenes.")
    ] = False,
    cache: Annotated[
        Path, typer.Option(help="A folder that keeps scenes and the best of the list.")
    ] = Path("out/scenes"),
    processes: Annotated[
        int, typer.Option(help="At work at a time.", min=1, max=MOST_PROCESSES)
    ] = MOST_PROCESSES,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="A module's constant to another value: tomo.X.NAME=VALUE."),
    ] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="An option of tomo.Options: NAME=VALUE.")
    ] = None,
) -> None:
    """Run one part of one half."""
    with bad_input_in_one_line():
        for name, value, known in (("--half", half, HALVES), ("--part", part, PARTS)):
            if value not in known:
                raise ValueError(f"{name}: found {value!r}, expected one of {', '.join(known)}")
        check_output_folder(out)
        constants, options = parsed(set_ or (), "--set"), parsed(option or (), "--option")
        Options.from_mapping(options)
        with patched(constants):
            pass
        trials = Trials(cache, out / "rows", options, constants, processes, resume)
        module, measure = PARTS[part]
        started = time.perf_counter()
        with progress_of(True, part) as progress:
            tables = measure(trials, half, quick=quick, progress=progress)
    result = {
        "study": "scenes",
        "half": half,
        "part": part,
        "quick": quick,
        "options": options,
        "constants": constants,
        "seconds": time.perf_counter() - started,
        "machine": machine(),
        "tables": tables,
    }
    write_json(out / f"{half}-{part}.json", plain(result, digits=5), indent=1)
    path = out / f"{half}-{part}.md"
    with atomic_path(path) as temporary:
        temporary.write_text(_page(result, module), "utf-8")
    say(str(path))


def _page(result: dict[str, Any], module: Any) -> str:
    """Return the tables as Markdown, with what they are."""
    title = f"# {result['part'].capitalize()}, {result['half']}"
    lines = [title, "", " ".join((module.__doc__ or "").split())]
    for name, rows in result["tables"].items():
        if rows and module.COLUMNS[name]:
            lines += [
                "",
                f"**{name.replace('_', ' ')}**",
                "",
                markdown(rows, module.COLUMNS[name]),
            ]
    return "\n".join(lines) + "\n"
