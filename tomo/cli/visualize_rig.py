"""``flametomo visualize-rig``: PNG for papers, HTML to turn around, GLB for 3-D viewers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tomo.cli.console import print_json, say
from tomo.cli.inputs import (
    Box,
    Drawing,
    check_output_pictures,
    load_rig_and_grid,
    read_volume_in,
)

if TYPE_CHECKING:
    from rigs import Rig
    from rigs.check.compare import RigDifference
    from tomo.grid import Volume, VoxelGrid

EXAMPLES = """
flametomo visualize-rig rig.yaml -o rig.html -o rig.png
flametomo visualize-rig scan --volume out/volume.npz --images scan
    -o rig.html
flametomo visualize-rig rig.yaml --compare other.yaml -o both.html
"""


def visualize_rig(
    rig: str,
    /,
    *,
    out: Sequence[Path],
    volume: Path | None = None,
    images: Path | None = None,
    frame: str | None = None,
    pattern: str | None = None,
    compare: str | None = None,
    align: bool = True,
    coverage: bool = True,
    json: bool = False,
    drawing: Drawing,
    box: Box,
) -> None:
    """Draw a rig's cameras and the volume that they look at.

    PNG suits papers, HTML can be turned around with parts switched on and off, GLB opens in 3-D
    viewers.

    Parameters
    ----------
    out : FILE
        A .png, .pdf, .svg, .html or .glb file to write; repeatable.
    volume : FILE
        Shown in its place. A volume file: .npz, .vti, .nrrd, .nhdr, .mha, .mhd, .npy with
        --spacing, or .nii and .nii.gz where nibabel is installed.
    images : FOLDER
        A scan or a folder CAMERA/FRAME.*, whose images .html and .glb show.
    frame : NAME
        Frame of the images; the first if absent.
    compare : RIG
        Another rig of the same cameras, to compare with.
    align :
        Align the other rig with the first by the best rigid motion.
    coverage :
        Show maps of views, resolved details and pixel size in .html.
    """
    check_output_pictures(out)
    from tomo.draw import visualize_rig as draw

    for option, given in (("--frame", frame), ("--pattern", pattern)):
        if given is not None and images is None:
            raise ValueError(f"{option}: expected --images with it")
    loaded, own = _load(rig)
    shown, voxels = _volume(loaded, own, volume, box)
    difference = _difference(loaded, compare, voxels, align)
    pictures = None
    if images is not None:
        from tomo.draw.rig.thumbnails import load_thumbnails

        pictures = load_thumbnails(loaded, images, frame, pattern, note=say)
    for path in out:
        draw(
            path,
            loaded,
            voxels,
            volume=shown,
            images=pictures,
            other=difference,
            names=(Path(rig).stem, Path(compare or "").stem),
            coverage=coverage,
            looks=drawing.looks,
            title=drawing.titled(Path(rig).stem),
        )
    if difference is not None:
        from tomo.draw.rig.rig_page import number

        say(
            f"ray-miss between both rigs: {number(difference.ray_miss)} {loaded.length_unit}; "
            f"turned by {number(difference.turn)} degrees, moved by {number(difference.shift)} "
            f"{loaded.length_unit} to lie over each other"
        )
    if json:
        result: dict[str, Any] = {
            "files": [str(path) for path in out],
            "cameras": list(loaded.names),
        }
        if difference is not None:
            result["difference"] = _plain(difference)
        print_json(result)


def _load(text: str) -> tuple[Rig, VoxelGrid | None]:
    """Return a rig with at least one camera, and the voxels that it or its scan names."""
    loaded, voxels = load_rig_and_grid(text)
    if not len(loaded):
        raise ValueError(f"{text}: cameras: found none, expected at least one to draw")
    return loaded, voxels


def _volume(
    rig: Rig, default: VoxelGrid | None, volume: Path | None, box: Box
) -> tuple[Volume | None, VoxelGrid | None]:
    """Return a volume, None without one, and the grid to draw."""
    if volume is None:
        return None, box.voxels(default) if box else default
    allowed = Box(spacing=box.spacing, center=box.center)
    if box != (allowed if volume.suffix.lower() == ".npy" else Box()):
        raise ValueError("--volume: has a grid of its own, expected no --grid with it")
    found = read_volume_in(volume, rig, box)
    return found, found.grid


def _difference(
    rig: Rig, compare: str | None, voxels: VoxelGrid | None, align: bool
) -> RigDifference | None:
    """Return how the other rig differs; None where there is none."""
    if compare is None:
        return None
    from tomo.draw.rig.rig_page import compare_on_grid

    try:
        return compare_on_grid(rig, _load(compare)[0], voxels, align=align)
    except ValueError as error:
        raise ValueError(f"--compare {compare}: {error}") from None


def _plain(difference: RigDifference) -> dict:
    """Return a difference as plain data; None where a figure is not known."""
    from rigs.files.text import plain

    cameras = {camera.name: asdict(camera) for camera in difference.cameras}
    for each in cameras.values():
        del each["name"]
    return plain(
        {
            "R": difference.R.tolist(),
            "t": difference.t.tolist(),
            "turn_degrees": difference.turn,
            "shift": difference.shift,
            "scale": difference.scale,
            "ray_miss": difference.ray_miss,
            "only_first": difference.only_first,
            "only_second": difference.only_second,
            "cameras": cameras,
        }
    )
