"""Train the encoder that comes with the package, and show how it transfers."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

from pathlib import Path
from typing import Annotated

import typer
from _command import bad_input_in_one_line, check_output_file, print_json, progress_bar
from _usage import OneLineUsage

app = typer.Typer(add_completion=False)


@app.command(cls=OneLineUsage)
def train_encoders(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The encoder to write, .pt.")
    ] = None,
    judge: Annotated[
        str | None, typer.Option(help="An encoder to judge on unseen scenes instead.")
    ] = None,
    scenes: Annotated[int, typer.Option(help="Random scenes to learn from.", min=1)] = 128,
    epochs: Annotated[int, typer.Option(help="How often each is seen.", min=1)] = 20,
    cases: Annotated[int | None, typer.Option(help="Judge by the first so many.", min=1)] = None,
    seed: Annotated[int, typer.Option(help="Of scenes and training.", min=0)] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Train an encoder on random rigs, voxels and volumes, or judge one on unseen scenes."""
    result: dict = {}
    with bad_input_in_one_line():
        if (out is None) == (judge is None):
            raise ValueError("--out and --judge: expected one of them")
        if out is not None:
            check_output_file(out)
        from _encoders.training import train_finite_pixels
        from _encoders.transfer import CASES, transfer

        from tomo.wernet import CorrectionEncoder, load_encoder, save_encoder

        if out is not None:
            with progress_bar("train") as progress:
                encoder, misfits = train_finite_pixels(
                    scenes=scenes, epochs=epochs, seed=seed, progress=progress
                )
            save_encoder(encoder, out)
            result = {"encoder": str(out), "misfit": misfits.tolist()}
        else:
            encoder = load_encoder(judge, CorrectionEncoder)
            chosen = CASES[:cases]
            rows = []
            with progress_bar("judge") as progress:
                for number, case in enumerate(chosen):
                    progress(number, len(chosen), f"{case.rig}, {case.phantom}")
                    rows.append(transfer(encoder, case).report())
            result = {"encoder": judge, "transfer": rows}
    if json:
        print_json(result)
