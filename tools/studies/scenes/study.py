"""The command that runs known scenes and writes what they came to: JSON and a page of tables."""

from __future__ import annotations

import time
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any

import typer

from rigs.files.text import plain, write_json, write_text
from rigs.progress import progress_of
from studies.common.page import sections
from studies.common.processes import MOST
from studies.common.results import machine
from studies.common.study import check_known
from studies.scenes import judge, learned, parts
from studies.scenes.compare import tables_of
from studies.scenes.design import everything, sample
from studies.scenes.patches import parsed, patched
from studies.scenes.recipe import HALVES
from studies.scenes.trial import Trials
from tomo import Options
from tomo.cli.console import bad_input_in_one_line, say
from tomo.cli.declared import command_line
from tomo.cli.inputs import check_output_folder

JUDGE = "judge"
MEASURED = {
    "accuracy": parts.accuracy,
    "ablation": parts.ablation,
    "intervals": parts.intervals,
    "learned": learned.learned,
}
PARTS = JUDGE, *MEASURED

QUICK_SECONDS = 660
"""From which no scene of a quick run is begun: it ends within a quarter of an hour."""


def command() -> typer.Typer:
    """Return the command line."""
    epilog = " ".join((judge.__doc__ or "").split())
    return command_line(run, "scenes", help=f"Run known scenes that nobody tuned on. {epilog}")


def run(
    half: Annotated[
        str, typer.Option(help=f"The families to run: {', '.join(HALVES)}.")
    ] = "settle",
    part: Annotated[str, typer.Option(help=f"What to measure: {', '.join(PARTS)}.")] = JUDGE,
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")] = Path(
        "out/scenes_study"
    ),
    rows: Annotated[
        Path | None,
        typer.Option(help="The rows of the judge, to be extended: OUT/HALF-rows.json if absent."),
    ] = None,
    compare: Annotated[
        tuple[Path, Path] | None,
        typer.Option(
            help="Run nothing; compare two files of rows, another tree's and this one's."
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer scenes: the judge ends within 15 minutes.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep what the folder holds of the same scenes.")
    ] = False,
    cache: Annotated[
        Path, typer.Option(help="A folder that keeps scenes and the best of the list.")
    ] = Path("out/scenes"),
    processes: Annotated[int, typer.Option(help="At work at a time.", min=1, max=MOST)] = MOST,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="A module's constant to another value: tomo.X.NAME=VALUE."),
    ] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="An option of tomo.Options: NAME=VALUE.")
    ] = None,
) -> None:
    """Run one part of one half."""
    started = time.perf_counter()
    with bad_input_in_one_line():
        check_known("--half", [half], HALVES)
        check_known("--part", [part], PARTS)
        check_output_folder(out)
        constants, options = parsed(set_ or (), "--set"), parsed(option or (), "--option")
        Options.from_mapping(options)
        if constants and part == JUDGE:
            raise ValueError(f"--set: found part {JUDGE}, expected another one")
        with patched(constants):
            pass
        about, tables = "", {}
        if compare:
            half, part = "", "compare"
            tables = tables_of(*map(judge.read_rows, compare))
        elif part == JUDGE:
            kept = rows or out / f"{half}-rows.json"
            recipes = sample(half) if quick else everything(half)
            seconds = QUICK_SECONDS if quick else float("inf")
            how: dict[str, Any] = {"processes": processes, "options": options}
            with progress_of(True, part) as how["progress"]:
                found = judge.extend(kept, recipes, cache, seconds=seconds, **how)
            wanted = {one.key for one in recipes}
            tables = tables_of({key: row for key, row in found.items() if key in wanted})
        else:
            trials = Trials(cache, out / "rows", options, constants, processes, resume)
            about = getdoc(MEASURED[part]) or ""
            with progress_of(True, part) as progress:
                tables = MEASURED[part](trials, half, quick=quick, progress=progress)
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
    name = "-".join(filter(None, (half, part)))
    write_json(out / f"{name}.json", plain(result, digits=5), indent=1)
    title = f"# {part.capitalize()}, {half}".rstrip(", ")
    lines = [title, "", " ".join(about.split()), *sections(tables)]
    write_text(out / f"{name}.md", "\n".join(lines) + "\n")
    say(str(out / f"{name}.md"))
