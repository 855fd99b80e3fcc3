"""Draw a rig: PNG for papers, HTML to turn around and switch on and off, GLB for 3-D viewers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from _command import bad_input_in_one_line, load_rig_or_preset, parse_grid, print_json
from _picture import check_outputs

if TYPE_CHECKING:
    from rigs import Rig

app = typer.Typer(add_completion=False)


@app.command()
def visualize_rig(
    rig: Annotated[
        str, typer.Argument(help="A rig.yaml, a preset's name, a scan folder or transforms.json.")
    ],
    out: Annotated[
        list[Path], typer.Option("--out", "-o", help=".png, .html or .glb; may stand repeatedly.")
    ],
    volume: Annotated[
        Path | None, typer.Option(help="A volume file to show in its place.")
    ] = None,
    grid: Annotated[
        str | None, typer.Option(help="Voxels, like 30x140x30; the rig's volume when absent.")
    ] = None,
    spacing: Annotated[
        str | None, typer.Option(help="A voxel's edge lengths: 0.5 or 0.5,0.5,1.")
    ] = None,
    center: Annotated[str | None, typer.Option(help="The middle of the grid: x,y,z.")] = None,
    title: Annotated[str | None, typer.Option(help="Stands above the picture.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Draw a rig's cameras, where they look, and the volume they look at."""
    with bad_input_in_one_line():
        check_outputs(out)
        from tomo.view.rig_scene import grid_of, rig_scene, up_of

        loaded = _load(rig)
        if not len(loaded):
            raise ValueError(f"{rig}: cameras: found none, expected at least one to draw")
        data = None
        if volume is not None:
            if grid or spacing or center:
                raise ValueError("--volume: has a grid of its own, expected no --grid beside it")
            data, voxels = _read(volume, loaded)
        elif grid or spacing or center:
            voxels = parse_grid(grid, spacing, center, default=grid_of(loaded))
        else:
            voxels = grid_of(loaded)
        heading = title if title is not None else Path(rig).stem
        scene = None
        for path in out:
            if path.suffix.lower() == ".png":
                from tomo.view import write_rig

                write_rig(path, loaded, grid=voxels, volume=data, title=heading)
                continue
            scene = scene or rig_scene(loaded, voxels, data)
            if path.suffix.lower() == ".html":
                from tomo.view import write_html

                up = up_of(loaded)
                write_html(path, scene, title=heading, up=up, grid=voxels, volume=data)
            else:
                from tomo.view import write_glb

                write_glb(path, scene)
    if json:
        print_json({"files": [str(path) for path in out], "cameras": list(loaded.names)})


def _load(text: str) -> Rig:
    """Return the rig of a file, a preset, a scan folder or a transforms.json."""
    path = Path(text)
    if path.is_dir():
        path = (
            path / "transforms.json" if (path / "transforms.json").exists() else path / "rig.yaml"
        )
    if path.suffix.lower() == ".json":
        from rigs.formats.transforms import load_transforms

        return load_transforms(path)[0]
    return load_rig_or_preset(text if path == Path(text) else str(path))


def _read(path: Path, rig: Rig) -> tuple:
    """Return data and grid of a volume that counts in the rig's unit."""
    from tomo.io import read_volume

    data, grid, unit = read_volume(path)
    if unit != rig.length_unit:
        raise ValueError(
            f"{path}: length_unit: found {unit!r}, expected {rig.length_unit!r}, the rig's"
        )
    return data, grid


if __name__ == "__main__":
    app()
