"""Draw what the default WERNet learns of effects it is not told, beside the truth."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

from pathlib import Path
from typing import Annotated

import typer
from _command import bad_input_in_one_line, check_output_file, print_json
from _usage import OneLineUsage

app = typer.Typer(add_completion=False)

FLAMES = ("jet", "turbulent")


@app.command(cls=OneLineUsage)
def learned_weights(
    out: Annotated[Path, typer.Option("--out", "-o", help="The PNG to write.")],
    effect: Annotated[
        str, typer.Option(help="One of the benchmark's, see docs/benchmark.md.")
    ] = "gains + absorption",
    flame: Annotated[str, typer.Option(help="jet or turbulent.")] = "jet",
    noise: Annotated[str, typer.Option(help="clean, or 2 %.")] = "2 %",
    seed: Annotated[int, typer.Option(help="Of flame, gains, noise and training.", min=0)] = 1,
    quick: Annotated[bool, typer.Option(help="Voxels of 1 mm instead of 0.5.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Draw what the default WERNet learns of effects it is not told, beside the truth."""
    with bad_input_in_one_line():
        check_output_file(out, (".png",))
        if flame not in FLAMES:
            raise ValueError(f"--flame: found {flame!r}, expected one of {', '.join(FLAMES)}")
        from _benchmark.mismatch_scenes import mismatch_scene
        from _benchmark.sizes import FULL, QUICK

        from tomo.view.figures import save_figure
        from tomo.view.learned_picture import draw_learned

        scene = mismatch_scene(effect, flame, noise, seed, QUICK if quick else FULL)
        found = scene.learned(uncertainty=0)
        if found.learned is None:
            reason = found.reconstruction.stop_reason
            raise ValueError(f"effect {effect}: found nothing learned: {reason}")
        save_figure(draw_learned(found.learned, scene.rig.length_unit), out)
    if json:
        figures = found.learned.report()
        figures.pop("profiles")
        figures["cosine_distance"] = found.reconstruction.quality["cosine_distance"]
        figures["seconds"] = found.seconds["total"]
        print_json(figures)
