"""Refine cameras from a flame's images where the truth, or a camera left out, can judge."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

import os
from pathlib import Path
from typing import Annotated

import typer
from _command import bad_input_in_one_line, check_output_folder, console, print_json
from _usage import OneLineUsage

app = typer.Typer(add_completion=False)

ROOT = Path(__file__).resolve().parent.parent


@app.command(cls=OneLineUsage)
def refinement_study(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")] = Path("docs"),
    seeds: Annotated[int, typer.Option(help="Disturbed rigs.", min=1, max=99)] = 6,
    quick: Annotated[
        bool, typer.Option("--quick", help="One small rig: whether it runs at all.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the findings.")] = False,
) -> None:
    """Write refinement.md and refinement.json: ray-miss and predictions, before and after.

    The real plume is judged where TOMO_TEST_DATA or ../shared/data has it.
    """
    with bad_input_in_one_line():
        check_output_folder(out)
        from _benchmark.machine import machine
        from _refinement.page import claims, page
        from _refinement.study import ERROR, plume, rigs_refined
        from _results import write_json, write_text

        data = Path(os.environ.get("TOMO_TEST_DATA", ROOT.parent / "shared" / "data"))
        numbers = range(1, 2 if quick else seeds + 1)
        result = {
            "machine": machine(),
            "options": " --quick" if quick else f" --seeds {seeds}" if seeds != 6 else "",
            "disturbed_rigs": rigs_refined(numbers, _say, error=ERROR, tiny=quick),
            "true_rigs": rigs_refined(numbers, _say, error=0.0, tiny=quick),
            "plume": [] if quick else plume(data, _say),
        }
        result["missed"] = claims(result)
        write_text(out / "refinement.md", page(result))
        write_json(out / "refinement.json", result, indent=1)
    for line in result["missed"] or ["everything wanted is met"]:
        _say(line)
    if json:
        print_json(result)


def _say(line: str) -> None:
    console.print(line, markup=False, highlight=False)
