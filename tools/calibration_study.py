"""Render boards with known truth, calibrate from them, and say how near the rigs come."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

import os
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from _command import bad_input_in_one_line, check_output_folder, console, print_json
from _usage import OneLineUsage

app = typer.Typer(add_completion=False)

ROOT = Path(__file__).resolve().parent.parent


@app.command(cls=OneLineUsage)
def calibration_study(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")] = Path("docs"),
    seeds: Annotated[int, typer.Option(help="Rigs of each kind.", min=1, max=99)] = 3,
    pictures: Annotated[
        Path | None,
        typer.Option(help="Keeps the rendered pictures for the next time; else they are deleted."),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A tiny rig: whether it runs at all.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the claims and findings.")] = False,
) -> None:
    """Write calibration.md and calibration.json: true ray-miss beside what was predicted.

    OpenCV's sample pairs are calibrated too where TOMO_TEST_DATA or ../shared/data has them.
    """
    with bad_input_in_one_line():
        check_output_folder(out)
        if pictures is not None:
            check_output_folder(pictures)
        from _benchmark.machine import machine
        from _calibration import results, study
        from _calibration.cases import CASES, TINY

        data = Path(os.environ.get("TOMO_TEST_DATA", ROOT.parent / "shared" / "data"))
        numbers = range(1, 2 if quick else seeds + 1)
        with tempfile.TemporaryDirectory() as temporary:
            folder = pictures or Path(temporary)
            studies = study.rendered(numbers, folder, _say, TINY if quick else CASES)
        studies["stereo"] = study.stereo(data, _say)
        studies["timing"] = study.timing(_say, *((3, 6) if quick else (12, 60)))
        options = " --quick" if quick else f" --seeds {seeds}" if seeds != 3 else ""
        written = results.save(
            out,
            {
                "format": results.FORMAT,
                "version": results.VERSION,
                "machine": machine(),
                "options": options,
                "studies": studies,
            },
        )
    met = sum(claim["met"] for claim in written["claims"])
    console.print(
        f"{met} of {len(written['claims'])} claims met; {out / results.PAGE}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    if json:
        print_json({"page": str(out / results.PAGE), "claims": written["claims"]})


def _say(line: str) -> None:
    console.print(line, markup=False, highlight=False)
