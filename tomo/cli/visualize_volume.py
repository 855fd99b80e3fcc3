"""``flametomo visualize-volume``: PNG for papers, HTML to turn around, GLB for viewers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tomo.cli.console import JsonFlag, print_json
from tomo.cli.errors import bad_input_in_one_line
from tomo.cli.inputs import VOLUME_HELP, ColormapOption, LevelOption, read_volume_file
from tomo.cli.outputs import check_output_pictures
from tomo.draw.suffixes import TURNING

EXAMPLES = """
flametomo visualize-volume out/volume.npz -o flame.html
flametomo visualize-volume out/volume.vti -o flame.png -o flame.gif
flametomo visualize-volume out/volume.npz --level 0.2 --level 0.6
    -o flame.glb
flametomo visualize-volume array.npy --spacing 0.5 -o flame.html
flametomo visualize-volume out.zarr -o film.html
"""


def visualize_volume(
    volume: Annotated[Path, typer.Argument(metavar="VOLUME", help=VOLUME_HELP)],
    out: Annotated[
        list[Path],
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="A .png, .html, .glb or .gif file to write; repeatable.",
        ),
    ],
    spacing: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH", help="Edge lengths of a voxel of a .npy: 0.5 or 0.5,0.5,1."
        ),
    ] = None,
    center: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Center of a .npy's grid; the origin if absent."),
    ] = None,
    length_unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="Unit of a .npy's lengths; mm if absent.")
    ] = None,
    frames: Annotated[
        str | None,
        typer.Option(metavar="A:B:C", help="A slice of a store's frames, counted from 0."),
    ] = None,
    level: LevelOption = None,
    colormap: ColormapOption = "inferno",
    title: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Title of the picture.")
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Draw a volume's light, its middle planes or its surfaces.

    PNG suits papers, HTML can be turned and cut, GLB opens surfaces in 3-D viewers, GIF turns
    once around. HTML of a store that reconstruct --frames wrote plays its film.
    """
    with bad_input_in_one_line():
        check_output_pictures(out, TURNING)
        if volume.suffix == ".zarr":
            return _film(volume, out, frames, title, json)
        if frames is not None:
            raise ValueError(f"--frames: found {frames!r}, expected it with a store like out.zarr")
        from tomo.draw import visualize_volume as draw
        from tomo.draw.emission import Looks

        data, grid, unit, value_unit = read_volume_file(
            volume, spacing, center, length_unit, allow_nan=True
        )
        heading = title if title is not None else volume.stem
        units = {"length_unit": unit, "value_unit": value_unit}
        looks = Looks(tuple(level or ()), colormap)
        for path in out:
            draw(path, data, grid, **units, title=heading, looks=looks)
    if json:
        print_json(
            {
                "files": [str(path) for path in out],
                "grid": grid.to_mapping(),
                "length_unit": unit,
                "value_unit": value_unit,
            }
        )


def _film(store: Path, out: list[Path], frames: str | None, title: str | None, json: bool) -> None:
    """Write pages that play the film of a store."""
    from tomo.draw import visualize_film
    from tomo.series import SeriesStore

    opened, numbers = SeriesStore(store), []
    heading = title if title is not None else store.stem
    for path in out:
        numbers = visualize_film(path, opened, frames or ":", title=heading, progress=True)
    if json:
        print_json(
            {
                "files": [str(path) for path in out],
                "grid": opened.grid.to_mapping(),
                "frames": numbers,
            }
        )
