"""Run the experiments of the WERNet paper again, and say what holds."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

import time
from pathlib import Path
from typing import Annotated

import typer
from _command import bad_input_in_one_line, check_output_folder, console, print_json, progress_bar
from _paper import PARTS
from _usage import OneLineUsage

app = typer.Typer(add_completion=False)


@app.command(cls=OneLineUsage)
def paper(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")] = Path("docs"),
    half: Annotated[
        bool,
        typer.Option(
            "--half",
            help="Fewer epochs; all but layouts and denoising on voxels twice as wide.",
        ),
    ] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Tiny problems: whether it runs at all.")
    ] = False,
    part: Annotated[
        list[str] | None,
        typer.Option(
            help=f"{', '.join(PARTS[:-1])} or {PARTS[-1]}; may be repeated. All if absent."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the parts that the folder holds already.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the claims and findings.")] = False,
) -> None:
    """Train WERNet on the paper's cases; write paper.md, and paper/ with JSON and figures.

    Every part is written as it ends: an interrupted run goes on with --resume.
    """
    with bad_input_in_one_line():
        for name in part or ():
            if name not in PARTS:
                raise ValueError(f"--part: found {name!r}, expected one of {', '.join(PARTS)}")
        asked = list(dict.fromkeys(part or PARTS))
        check_output_folder(out)
        import torch
        from _benchmark.machine import machine
        from _paper import results, sizes
        from _paper.studies import PARTS as RUN

        size = sizes.QUICK if quick else sizes.HALF if half else sizes.FULL
        kept = results.load(out, size.name) if resume else {}
    result = kept or {
        "format": results.FORMAT,
        "version": results.VERSION,
        "size": size.name,
        "machine": machine(),
        "threads": torch.get_num_threads(),
        "parts": {},
    }
    done = dict(result["parts"])
    written = results.save(out, result, size)
    for name in asked:
        if name in done:
            continue
        started = time.perf_counter()
        with progress_bar(name) as progress:
            studies = RUN[name](size, progress)
        done[name] = {"seconds": time.perf_counter() - started, "studies": studies}
        result["parts"] = {name: done[name] for name in PARTS if name in done}
        written = results.save(out, result, size, fresh=(name,))
        console.print(f"{name}: {done[name]['seconds']:.0f} s", highlight=False)
    holding = sum(claim["holds"] for claim in written["claims"])
    console.print(
        f"{holding} of {len(written['claims'])} claims hold; {out / results.PAGE}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    if json:
        print_json({"page": str(out / results.PAGE), "claims": written["claims"]})
