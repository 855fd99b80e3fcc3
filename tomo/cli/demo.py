"""``flametomo demo``: a flame, its images and its reconstruction, to see what comes out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tomo.cli.console import say
from tomo.cli.reconstruct import reconstruct
from tomo.cli.simulate import simulate
from tomo.cli.visualize_rig import visualize_rig

EXAMPLES = """
flametomo demo
flametomo demo -o flame
"""


def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="The folder to write.")
    ] = Path("out/demo"),
) -> None:
    """Simulate a turbulent flame, reconstruct it, and write the report.

    Runs three other verbs and prints each command. 33 cameras look at the flame. Its images are
    simulated with 2 x 2 rays per pixel and voxels half as wide as those reconstructed, so that
    the reconstruction does not rely on the discretisation of the simulation.
    """
    scan = out / "scan"
    say(
        "== flametomo simulate --rig paper33_pitch --phantom turbulent --grid 20x94x20 "
        f"--spacing 0.75 --supersample 2 --refine 2 --seed 1 -o {scan}"
    )
    grid, spacing = "20x94x20", "0.75"
    simulate("paper33_pitch", "turbulent", scan, grid, spacing, supersample=2, refine=2, seed=1)
    say(f"== flametomo reconstruct {scan} -o {out}")
    reconstruct(out, scan)
    picture = out / "rig.html"
    say(f"== flametomo visualize-rig {scan} --volume {out / 'volume.npz'} -o {picture}")
    visualize_rig(str(scan), [picture], volume=out / "volume.npz")
    say(f"Open {out / 'report.html'} for the result and {picture} for the cameras.")
