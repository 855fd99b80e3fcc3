"""``flametomo visualize-volume``: PNG for papers, HTML to turn around, GLB for viewers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tomo.cli.console import print_json
from tomo.cli.inputs import BareArray, Drawing, check_output_pictures, read_volume_file
from tomo.draw.figures import TURNING

EXAMPLES = """
flametomo visualize-volume out/volume.npz -o flame.html
flametomo visualize-volume out/volume.vti -o flame.png -o flame.gif
flametomo visualize-volume out/volume.npz --level 0.2 --level 0.6
    -o flame.glb
flametomo visualize-volume array.npy --spacing 0.5 -o flame.html
flametomo visualize-volume out.zarr -o film.html
"""


def visualize_volume(
    volume: Path,
    /,
    *,
    out: Sequence[Path],
    frames: str | None = None,
    json: bool = False,
    drawing: Drawing,
    array: BareArray,
) -> None:
    """Draw a volume's light, its middle planes or its surfaces.

    PNG suits papers, HTML can be turned and cut, GLB opens surfaces in 3-D viewers, GIF turns
    once around. HTML of a store that reconstruct --frames wrote plays its film.

    Parameters
    ----------
    volume : VOLUME
        A volume file: .npz, .vti, .nrrd, .nhdr, .mha, .mhd, .npy with --spacing, or .nii and
        .nii.gz where nibabel is installed.
    out : FILE
        A .png, .pdf, .svg, .html, .glb or .gif file to write; repeatable.
    frames : A:B:C
        A slice of a store's frames, counted from 0.
    """
    check_output_pictures(out, TURNING)
    if volume.suffix == ".zarr":
        if array != BareArray() or drawing.level or drawing.colormap != Drawing.colormap:
            raise ValueError(
                f"{volume}: found --level, --colormap, --spacing, --center or --length-unit, "
                "expected none with a film"
            )
        return _film(volume, out, frames, drawing.titled(volume.stem), json)
    if frames is not None:
        raise ValueError(f"--frames: found {frames!r}, expected it with a store like out.zarr")
    from tomo.draw import visualize_volume as draw

    data = read_volume_file(volume, array, allow_nan=True)
    for path in out:
        draw(path, data, title=drawing.titled(volume.stem), looks=drawing.looks)
    if json:
        units = {"length_unit": data.length_unit, "value_unit": data.value_unit}
        print_json({"files": [*map(str, out)], "grid": data.grid.to_mapping(), **units})


def _film(store: Path, out: Sequence[Path], frames: str | None, title: str, json: bool) -> None:
    """Write pages that play the film of a store."""
    from tomo.draw import visualize_film
    from tomo.series import SeriesStore

    opened, numbers = SeriesStore(store), []
    for path in out:
        numbers = visualize_film(path, opened, frames or ":", title=title, progress=True)
    if json:
        grid = opened.grid.to_mapping()
        print_json({"files": [*map(str, out)], "grid": grid, "frames": numbers})
