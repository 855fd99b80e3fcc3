"""Inputs that several commands take: voxel grids and rigs."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tomo.cli.console import say

if TYPE_CHECKING:
    from rigs import Rig
    from tomo import Scan, VoxelGrid

_RIG = {
    "metavar": "RIG",
    "help": "A rig.yaml, a preset's name, a scan, or a file of another format.",
}
RigArgument = Annotated[str, typer.Argument(**_RIG)]
RigOption = Annotated[str, typer.Option("--rig", **_RIG)]
_PANEL = {"rich_help_panel": "Voxel grid"}

GridOption = Annotated[
    str | None,
    typer.Option(metavar="NxNxN", help="Voxels along x, y and z, like 30x140x30.", **_PANEL),
]
SpacingOption = Annotated[
    str | None,
    typer.Option(metavar="LENGTH", help="Edge lengths of a voxel: 0.5 or 0.5,0.5,1.", **_PANEL),
]
CenterOption = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="Center of the grid.", **_PANEL)
]
LowerOption = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z", help="Lower corner, in place of --spacing and --center.", **_PANEL
    ),
]
UpperOption = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="Upper corner, with --lower.", **_PANEL)
]

LevelOption = Annotated[
    list[float] | None,
    typer.Option(
        metavar="PART",
        help="Draw a surface at this part of the largest value, like 0.4, in place of the light; "
        "up to three.",
    ),
]
ColormapOption = Annotated[
    str, typer.Option(metavar="NAME", help="Colours of the light: a colour map of matplotlib.")
]

ScanArgument = Annotated[
    Path | None,
    typer.Argument(metavar="SCAN", help="A scan folder, scan.yaml or transforms.json."),
]
RigInsteadOption = Annotated[
    Path | None,
    typer.Option("--rig", metavar="FILE", help="A rig.yaml, with --images, in place of SCAN."),
]
ImagesOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Images CAMERA/FRAME.tif or CAMERA_FRAME.tif, or films CAMERA.tif, with --rig; "
        "or where those of a transforms.json are.",
    ),
]

PatternOption = Annotated[
    str | None,
    typer.Option(
        metavar="PATTERN",
        help="How the files of --images are named, where not as CAMERA/FRAME.tif, "
        "CAMERA_FRAME.tif or CAMERA.tif: '{frame}/{camera}.png', say.",
    ),
]


VOLUME_HELP = (
    "A volume file: .npz, .vti, .nrrd, .nhdr, .mha, .mhd, .npy with --spacing, or .nii and "
    ".nii.gz where nibabel is installed."
)


def named_scan(
    scan: Path | None, rig: Path | None, images: Path | None, pattern: str | None
) -> Scan:
    """Return the scan that a command's arguments name; cameras found by a pattern are said."""
    from rigs.recordings.layout import cameras_and_frames
    from tomo import load_scan, scan_of_images

    if pattern is not None and rig is None:
        raise ValueError(f"--pattern: found {pattern!r}, expected --rig and --images with it")
    if scan is not None and rig is None:
        return load_scan(scan, images)
    if scan is None and rig is not None and images is not None:
        found = scan_of_images(rig, images, pattern)
        if pattern is not None:
            names = found.rig.names
            each = {n: [f.name for f in found.frames if n in f.images] for n in names}
            say(cameras_and_frames(each))
        return found
    raise ValueError("SCAN: expected either a scan, or --rig and --images together")


def parse_grid_shape(text: str, option: str = "--grid") -> tuple[int, int, int]:
    """Return the counts of ``30x140x30``."""
    match = re.fullmatch(r"(\d{1,9})x(\d{1,9})x(\d{1,9})", text.strip().lower(), re.ASCII)
    if match is None:
        raise ValueError(
            f"{option}: found {text!r}, expected three counts like 30x140x30, below 10^9"
        )
    nx, ny, nz = map(int, match.groups())
    return nx, ny, nz


def parse_triple(text: str, option: str) -> tuple[float, float, float]:
    """Return the numbers of ``x,y,z``; they may start with a minus sign."""
    numbers = _numbers(text)
    if numbers is None or len(numbers) != 3:
        raise ValueError(f"{option}: found {text!r}, expected three numbers like -1.5,0,2")
    x, y, z = numbers
    return x, y, z


def parse_spacing(text: str, option: str = "--spacing") -> tuple[float, float, float]:
    """Return the edge lengths of ``0.5`` or ``0.5,0.5,1``."""
    numbers = _numbers(text)
    if numbers is None or len(numbers) not in (1, 3) or min(numbers) <= 0:
        raise ValueError(f"{option}: found {text!r}, expected lengths like 0.5 or 0.5,0.5,1")
    x, y, z = numbers * (3 // len(numbers))
    return x, y, z


def _numbers(text: str) -> list[float] | None:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return None
    return numbers if all(math.isfinite(number) for number in numbers) else None


def parse_grid(
    shape: str | None,
    spacing: str | None = None,
    center: str | None = None,
    lower: str | None = None,
    upper: str | None = None,
    default: VoxelGrid | None = None,
) -> VoxelGrid:
    """Return the grid that the options describe; what they omit is taken from ``default``.

    Either ``lower`` and ``upper`` with a shape, or any of shape, spacing and center.
    """
    from tomo import VoxelGrid

    if lower is not None or upper is not None:
        given = {"--lower": lower, "--upper": upper, "--spacing": spacing, "--center": center}
        found = [name for name, value in given.items() if value is not None]
        if lower is None or upper is None or len(found) > 2:
            raise ValueError(
                f"--lower and --upper: found {', '.join(found)}, expected both, with --grid's "
                "counts and neither --spacing nor --center"
            )
        counts = parse_grid_shape(shape) if shape else default and default.shape
        if counts is None:
            raise ValueError("--grid: found none, expected counts like 30x140x30")
        bounds = parse_triple(lower, "--lower"), parse_triple(upper, "--upper")
        return VoxelGrid.from_bounds(counts, *bounds)
    if default is None:
        if not shape or not spacing:
            raise ValueError(
                "--grid and --spacing: expected both, like --grid 30x140x30 --spacing 0.5, "
                "as neither scan nor rig says where the volume is"
            )
        place = parse_triple(center, "--center") if center else (0, 0, 0)
        return VoxelGrid(parse_grid_shape(shape), parse_spacing(spacing), place)
    return VoxelGrid(
        parse_grid_shape(shape) if shape else default.shape,
        parse_spacing(spacing) if spacing else default.spacing,
        parse_triple(center, "--center") if center else default.center,
    )


def read_volume_file(
    path: str | Path,
    spacing: str | None = None,
    center: str | None = None,
    length_unit: str | None = None,
    *,
    allow_nan: bool = False,
) -> tuple:
    """Return data, grid and both units of a volume; options are for a .npy, which has no grid."""
    from tomo.io import read_volume_with_unit

    given = {
        "spacing": parse_spacing(spacing) if spacing else None,
        "center": parse_triple(center, "--center") if center else None,
        "length_unit": length_unit,
    }
    return read_volume_with_unit(path, allow_nan=allow_nan, **given)


def read_volume_in(
    path: str | Path, rig: Rig, spacing: str | None = None, center: str | None = None
) -> tuple:
    """Return data, grid and unit of the values of a volume in a rig's unit of length."""
    if Path(path).suffix.lower() == ".npy":
        return *read_volume_file(path, spacing, center, rig.length_unit)[:2], ""
    data, grid, unit, value_unit = read_volume_file(path)
    if unit != rig.length_unit:
        raise ValueError(
            f"{path}: length_unit: found {unit!r}, expected {rig.length_unit!r}, the rig's"
        )
    return data, grid, value_unit


def load_rig_or_preset(text: str) -> Rig:
    """Return the rig of a preset, a scan, or a file or folder of any known format."""
    return load_rig_and_grid(text)[0]


def load_rig_and_grid(text: str) -> tuple[Rig, VoxelGrid | None]:
    """Return such a rig, and the grid that the scan or the rig itself names, or None."""
    from rigs import load, preset_names
    from tomo.grid import grid_of_rig
    from tomo.scan.files import is_scan_file

    path, grid = Path(text), None
    is_named = text in preset_names()
    if not is_named and ((path / "scan.yaml").is_file() or is_scan_file(path)):
        from tomo import load_scan

        scan = load_scan(path)
        rig, grid = scan.rig, scan.grid
    else:
        rig = load(text)
    return rig, grid or grid_of_rig(rig)
