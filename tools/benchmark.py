"""Chart run time against error: projectors, solvers, skipping, growth, and start-up."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from _benchmark import PARTS
from _command import bad_input_in_one_line, check_output_folder, console, print_json, progress_bar
from _usage import OneLineUsage

app = typer.Typer(add_completion=False)


@app.command(cls=OneLineUsage)
def benchmark(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")],
    quick: Annotated[bool, typer.Option("--quick", help="Smaller problems: 3 minutes.")] = False,
    part: Annotated[
        list[str] | None,
        typer.Option(
            help=f"{', '.join(PARTS[:-1])} or {PARTS[-1]}; may be repeated. All if absent."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the parts that the folder holds already.")
    ] = False,
    redo: Annotated[
        list[str] | None, typer.Option(help="With --resume: a part to run again; may be repeated.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(help="A folder of real image sets, for skipping.")
    ] = None,
    processes: Annotated[
        int,
        typer.Option(
            min=1, max=999, help="Work on so many scenes of mismatch at a time, a thread each."
        ),
    ] = 1,
    tiny: Annotated[bool, typer.Option("--tiny", hidden=True)] = False,
    json: Annotated[bool, typer.Option("--json", help="Print what was wanted and found.")] = False,
) -> None:
    """Measure run time against error and memory; write JSON, a page of tables, and plots.

    Every part is written as it ends: an interrupted run goes on with --resume.
    """
    with bad_input_in_one_line():
        asked = _known(part, "--part") or list(PARTS)
        again = _known(redo, "--redo")
        if again and not resume:
            raise ValueError("--redo: expected --resume beside it")
        check_output_folder(out)
        from _benchmark import plume, results, sizes
        from _benchmark.machine import load, machine
        from _benchmark.parts import PARTS as RUN
        from _benchmark.parts import Asked
        from _benchmark.warm import warm_up

        if data is not None:
            plume.check_data(data)
        size = sizes.TINY if tiny else sizes.QUICK if quick else sizes.FULL
        here = machine()
        kept = results.load(out, size.name, here) if resume else {}
    result = kept or {
        "format": results.FORMAT,
        "version": results.VERSION,
        "size": size.name,
        "machine": here,
        "parts": {},
    }
    records = dict(result["parts"])
    begun = {name: rows for name, rows in result.get("begun", {}).items() if name not in again}
    done = set(records).difference(again, begun)  # one begun again stands until it ends anew
    console.print("warming up compiled code")
    result["first_use_seconds"] = warm_up()
    for name in asked:
        if name in done:
            continue
        started, loaded = time.perf_counter(), load()
        keep = partial(results.keep, out, {**result, "begun": begun}, name)
        with progress_bar(name) as progress:
            part = Asked(size, progress, data, processes, begun.get(name, ()), keep)
            studies, notes = RUN[name](part)
        records[name] = {
            "seconds": time.perf_counter() - started,
            "load_at_start": loaded,
            "notes": notes,
            "studies": studies,
        }
        begun.pop(name, None)
        result["begun"] = begun
        result["parts"] = {name: records[name] for name in PARTS if name in records}
        results.save(out, result)
        console.print(f"{name}: {records[name]['seconds']:.0f} s", highlight=False)
    written = results.save(out, result)
    missed = [claim for claim in written["claims"] if not claim["met"]]
    console.print(
        f"{len(written['claims']) - len(missed)} of {len(written['claims'])} aims met; "
        f"{out / results.PAGE}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    if json:
        print_json({"page": str(out / results.PAGE), "claims": written["claims"]})


def _known(names: list[str] | None, option: str) -> list[str]:
    for name in names or ():
        if name not in PARTS:
            raise ValueError(f"{option}: found {name!r}, expected one of {', '.join(PARTS)}")
    return list(dict.fromkeys(names or ()))
