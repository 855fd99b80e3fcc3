"""Attack the toolkit: extreme geometry, values, conditions, damaged files, killed processes."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

import time
from pathlib import Path
from typing import Annotated

import typer
from _command import bad_input_in_one_line, check_output_folder, console, print_json, progress_bar
from _stress import AREAS
from _usage import OneLineUsage

app = typer.Typer(add_completion=False)


@app.command(cls=OneLineUsage)
def stress(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")],
    quick: Annotated[bool, typer.Option("--quick", help="Less of each: 3 minutes.")] = False,
    area: Annotated[
        list[str] | None,
        typer.Option(help=f"{', '.join(AREAS)}; may be repeated. All if absent."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the areas that the folder holds already.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Of everything random.", min=0)] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the rows.")] = False,
) -> None:
    """Write stress.md, stress.json and plots: each row a stress, its range, figure and bound.

    Every area is written as it ends: an interrupted run goes on with --resume. Ends with exit
    code 1 where a row does not hold.
    """
    with bad_input_in_one_line():
        for name in area or ():
            if name not in AREAS:
                known = ", ".join(AREAS)
                raise ValueError(f"--area: found {name!r}, expected one of {known}")
        check_output_folder(out)
        from _benchmark.machine import load, machine
        from _stress import results
        from _stress.areas import run
        from _stress.row import Size

        size = Size(quick=quick, seed=seed)
        here = machine()
        kept = results.load(out, size) if resume else {}
    result = kept or results.fresh(size, here)
    done = dict(result["areas"])
    for name in area or AREAS:
        if name in done and (not area or resume):
            continue
        started, loaded = time.perf_counter(), load()
        with progress_bar(name) as progress:
            rows = run(name, size, progress)
        done[name] = {
            "seconds": time.perf_counter() - started,
            "load_at_start": loaded,
            "rows": rows,
        }
        result["areas"] = {key: done[key] for key in AREAS if key in done}
        results.save(out, result, name)
        missed = sum(not row["holds"] for row in rows)
        _say(f"{name}: {len(rows)} rows, {missed} do not hold; {done[name]['seconds']:.0f} s")
    rows = [row for record in result["areas"].values() for row in record["rows"]]
    missed = [row for row in rows if not row["holds"]]
    _say(f"{len(rows) - len(missed)} of {len(rows)} rows hold; {out / results.PAGE}")
    if json:
        print_json({"page": str(out / results.PAGE), "rows": rows})
    if missed:
        raise typer.Exit(1)


def _say(line: str) -> None:
    console.print(line, markup=False, highlight=False, soft_wrap=True)
