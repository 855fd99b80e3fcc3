"""Draw a volume: PNG for papers, HTML to turn around and switch on and off, GLB for viewers."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

from pathlib import Path
from typing import Annotated

import typer
from _command import bad_input_in_one_line, print_json
from _picture import check_outputs
from _usage import OneLineUsage

app = typer.Typer(add_completion=False)


@app.command(cls=OneLineUsage)
def visualize_volume(
    volume: Annotated[Path, typer.Argument(help="A volume file: .npz, .vti or .nrrd.")],
    out: Annotated[
        list[Path], typer.Option("--out", "-o", help=".png, .html or .glb; may stand repeatedly.")
    ],
    title: Annotated[str | None, typer.Option(help="Stands above the picture.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Draw a volume's middle planes, line integrals and surfaces of equal emission."""
    with bad_input_in_one_line():
        check_outputs(out)
        from tomo.draw.rig.rig_scene import volume_scene
        from tomo.draw.volume import isosurface_scene
        from tomo.io import read_volume

        data, grid, unit = read_volume(volume, allow_nan=True)
        heading = title if title is not None else volume.stem
        scene = None
        for path in out:
            if path.suffix.lower() == ".png":
                from tomo.draw.volume import write_volume_picture

                write_volume_picture(path, data, grid, length_unit=unit, title=heading)
                continue
            scene = scene or volume_scene(grid, unit) + isosurface_scene(data, grid, unit)
            if path.suffix.lower() == ".html":
                from tomo.draw import write_html

                write_html(path, scene, title=heading, volume=data, grid=grid)
            else:
                from tomo.draw import write_glb

                write_glb(path, scene)
    if json:
        print_json(
            {
                "files": [str(path) for path in out],
                "grid": {
                    "shape": list(grid.shape),
                    "spacing": list(grid.spacing),
                    "center": list(grid.center),
                },
            }
        )
