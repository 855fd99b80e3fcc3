"""Draw a rig: PNG for papers, HTML to turn around and switch on and off, GLB for 3-D viewers."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from _command import (
    bad_input_in_one_line,
    console,
    finite_or_none,
    load_rig_and_grid,
    parse_grid,
    print_json,
)
from _picture import check_outputs

if TYPE_CHECKING:
    from rigs import Rig
    from rigs.check.compare import RigDifference
    from tomo.draw import Scene
    from tomo.grid import VoxelGrid

from _usage import OneLineUsage

app = typer.Typer(add_completion=False)


@app.command(cls=OneLineUsage)
def visualize_rig(
    rig: Annotated[
        str,
        typer.Argument(help="A rig.yaml, a preset's name, a scan, or a file of another format."),
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
    images: Annotated[
        Path | None,
        typer.Option(help="A scan, or a folder <camera>/<frame>.*: pictures for .html and .glb."),
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="Which moment of the images; the first if absent.")
    ] = None,
    compare: Annotated[
        str | None, typer.Option(help="Another rig of the same cameras, drawn and tabled beside.")
    ] = None,
    align: Annotated[
        bool, typer.Option(help="Lay the other rig over the first by the best rigid motion.")
    ] = True,
    coverage: Annotated[
        bool, typer.Option(help="In .html: maps of views, angular gap and pixel size.")
    ] = True,
    title: Annotated[str | None, typer.Option(help="Stands above the picture.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Draw a rig's cameras, where they look, and the volume they look at."""
    with bad_input_in_one_line():
        check_outputs(out)
        loaded, own = _load(rig)
        data, voxels = _volume(loaded, own, volume, grid, spacing, center)
        heading = title if title is not None else Path(rig).stem
        difference = _difference(loaded, compare, voxels, align)
        beside = _beside(loaded, voxels, difference)
        pictures = _pictures(loaded, images, frame)
        for path in out:
            suffix = path.suffix.lower()
            if suffix == ".png":
                from tomo.draw.rig import write_rig

                shown = beside.without("other names")  # beside the first rig's own
                write_rig(path, loaded, grid=voxels, volume=data, title=heading, beside=shown)
                continue
            scene = _scene(loaded, voxels, data, pictures) + beside
            if suffix == ".glb":
                from tomo.draw import write_glb

                write_glb(path, scene)
                continue
            tables = []
            if difference is not None:
                from tomo.draw.rig.rig_page import difference_table

                names = Path(rig).stem, Path(compare).stem
                tables.append(difference_table(difference, loaded.length_unit, *names))
            _write_page(path, loaded, voxels, data, scene, pictures, tables, coverage, heading)
    if difference is not None:
        from tomo.draw.rig.rig_page import number

        unit = loaded.length_unit
        console.print(
            f"ray-miss between both rigs: {number(difference.ray_miss)} {unit}; turned by "
            f"{number(difference.turn)} degrees, moved by {number(difference.shift)} {unit} "
            "to lie over each other",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )
    if json:
        told = {"files": [str(path) for path in out], "cameras": list(loaded.names)}
        if difference is not None:
            told["difference"] = _plain(difference)
        print_json(told)


def _load(text: str) -> tuple[Rig, VoxelGrid | None]:
    """Return a rig with at least one camera, and the voxels that it or its scan names."""
    loaded, voxels = load_rig_and_grid(text)
    if not len(loaded):
        raise ValueError(f"{text}: cameras: found none, expected at least one to draw")
    return loaded, voxels


def _volume(
    rig: Rig,
    default: VoxelGrid | None,
    volume: Path | None,
    grid: str | None,
    spacing: str | None,
    center: str | None,
) -> tuple:
    """Return a volume's data, None without one, and the grid to draw, None without one."""
    if volume is None:
        asked = grid or spacing or center
        return None, parse_grid(grid, spacing, center, default=default) if asked else default
    if grid or spacing or center:
        raise ValueError("--volume: has a grid of its own, expected no --grid beside it")
    from tomo.io import read_volume

    data, voxels, unit = read_volume(volume)
    if unit != rig.length_unit:
        raise ValueError(
            f"{volume}: length_unit: found {unit!r}, expected {rig.length_unit!r}, the rig's"
        )
    return data, voxels


def _difference(
    rig: Rig, compare: str | None, voxels: VoxelGrid | None, align: bool
) -> RigDifference | None:
    """Return how the other rig differs; None where there is none."""
    if compare is None:
        return None
    from rigs import compare_rigs
    from tomo.draw.rig.coverage_maps import coverage_grid
    from tomo.draw.rig.rig_scene import Target

    if voxels is not None:
        points = coverage_grid(voxels, 500).centers().reshape(-1, 3)
    else:
        points = Target.of(rig, None).center[None]
    try:
        return compare_rigs(rig, _load(compare)[0], points, align=align)
    except ValueError as error:
        raise ValueError(f"--compare {compare}: {error}") from None


def _beside(rig: Rig, voxels: VoxelGrid | None, difference: RigDifference | None) -> Scene:
    """Return what is drawn beside the cameras: targets as they were held, the other rig."""
    from tomo.draw.rig.rig_page import other_rig_scene, target_scene

    scene = target_scene(rig)
    return scene if difference is None else scene + other_rig_scene(rig, difference, voxels)


def _pictures(rig: Rig, images: Path | None, frame: str | None) -> dict:
    """Return thumbnails by camera; none without images."""
    if images is None:
        if frame is not None:
            raise ValueError("--frame: expected --images beside it")
        return {}
    from tomo.draw.rig.thumbnails import load_thumbnails

    return load_thumbnails(rig, images, frame)


def _scene(rig: Rig, voxels: VoxelGrid | None, data: object, pictures: dict) -> Scene:
    """Return the rig's scene with what its cameras saw."""
    from tomo.draw.rig import rig_scene
    from tomo.draw.rig.rig_scene import Target
    from tomo.draw.rig.thumbnails import image_scene

    scene = rig_scene(rig, voxels, data)
    return scene + image_scene(rig, Target.of(rig, voxels), pictures)


def _write_page(
    path: Path,
    rig: Rig,
    voxels: VoxelGrid | None,
    data: object,
    scene: Scene,
    pictures: dict,
    tables: list,
    coverage: bool,
    heading: str,
) -> None:
    from tomo.draw import write_html
    from tomo.draw.rig.camera_view import camera_views
    from tomo.draw.rig.rig_scene import up_of

    if coverage and voxels is not None:
        from tomo.draw.rig.coverage_maps import coverage_maps, coverage_scene
        from tomo.draw.rig.rig_page import check_on_grid, check_table

        check, coarse = check_on_grid(rig, voxels)
        maps = coverage_maps(check.coverage, coarse, check.voxel)
        scene += coverage_scene(maps, coarse, rig.length_unit)
        tables = [*tables, check_table(check)]
    write_html(
        path,
        scene,
        title=heading,
        up=up_of(rig),
        grid=voxels,
        volume=data,
        views=camera_views(rig, voxels, pictures),
        tables=tables,
        shown=["images"] if pictures else [],
    )


def _plain(difference: RigDifference) -> dict:
    """Return a difference as plain data; None where a figure is not known."""
    return {
        "R": difference.R.tolist(),
        "t": difference.t.tolist(),
        "turn_degrees": difference.turn,
        "shift": difference.shift,
        "scale": finite_or_none(difference.scale),
        "ray_miss": finite_or_none(difference.ray_miss),
        "only_first": list(difference.only_first),
        "only_second": list(difference.only_second),
        "cameras": {
            camera.name: {
                name: finite_or_none(value)
                for name, value in asdict(camera).items()
                if name != "name"
            }
            for camera in difference.cameras
        },
    }
