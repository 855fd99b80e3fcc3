"""What several commands take: grids, rigs, scans and volumes; and checks of what they write."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tomo.draw.figures import PICTURE_SUFFIXES

if TYPE_CHECKING:
    from rigs import Rig
    from tomo import Volume, VoxelGrid
    from tomo.draw.emission import Looks


@dataclass(frozen=True)
class Box:
    """Where the voxels are.

    Voxel grid
    ----------
    grid : NxNxN
        Voxels along x, y and z, like 30x140x30.
    spacing : LENGTH
        Edge lengths of a voxel: 0.5 or 0.5,0.5,1.
    center : X,Y,Z
        Center of the grid.
    lower : X,Y,Z
        Lower corner, in place of --spacing and --center.
    upper : X,Y,Z
        Upper corner, with --lower.
    """

    grid: str | None = None
    spacing: str | None = None
    center: str | None = None
    lower: str | None = None
    upper: str | None = None

    def __bool__(self) -> bool:
        """Return whether anything was given."""
        return self != Box()

    @property
    def is_placed(self) -> bool:
        """Whether it was given where the grid is."""
        return (self.center, self.lower, self.upper) != (None, None, None)

    def voxels(self, default: VoxelGrid | None = None) -> VoxelGrid:
        """Return the grid; what was not given is taken from ``default``."""
        from tomo import VoxelGrid

        if self.lower is not None or self.upper is not None:
            return self._between(default)
        if default is None and not (self.grid and self.spacing):
            raise ValueError(
                "--grid and --spacing: expected both, like --grid 30x140x30 --spacing 0.5, "
                "as neither scan nor rig says where the volume is"
            )
        own = default or VoxelGrid((1, 1, 1), 1.0)
        return VoxelGrid(
            parse_grid_shape(self.grid) if self.grid else own.shape,
            parse_spacing(self.spacing) if self.spacing else own.spacing,
            parse_triple(self.center, "--center") if self.center else own.center,
        )

    def _between(self, default: VoxelGrid | None) -> VoxelGrid:
        """Return the grid between two corners."""
        from tomo import VoxelGrid

        found = [
            f"--{name}"
            for name in ("lower", "upper", "spacing", "center")
            if getattr(self, name) is not None
        ]
        if self.lower is None or self.upper is None or len(found) > 2:
            raise ValueError(
                f"--lower and --upper: found {', '.join(found)}, expected both, with --grid's "
                "counts and neither --spacing nor --center"
            )
        counts = parse_grid_shape(self.grid) if self.grid else default and default.shape
        if counts is None:
            raise ValueError("--grid: found none, expected counts like 30x140x30")
        bounds = parse_triple(self.lower, "--lower"), parse_triple(self.upper, "--upper")
        return VoxelGrid.from_bounds(counts, *bounds)


@dataclass(frozen=True)
class BareArray:
    """What a .npy does not say.

    A .npy, which has no grid
    -------------------------
    spacing : LENGTH
        Edge lengths of its voxels: 0.5 or 0.5,0.5,1.
    center : X,Y,Z
        Center of its grid; the origin if absent.
    length_unit : UNIT
        Unit of its lengths; mm if absent.
    """

    spacing: str | None = None
    center: str | None = None
    length_unit: str | None = None


@dataclass(frozen=True)
class Drawing:
    """How volumes are drawn.

    Parameters
    ----------
    level : PART
        Draw a surface at this part of the largest value, like 0.4, in place of the light; up to
        three.
    colormap : NAME
        Colours of the light: a colour map of matplotlib.
    title : TEXT
        Title of the picture.
    """

    level: Sequence[float] | None = None
    colormap: str = "inferno"
    title: str | None = None

    @property
    def looks(self) -> Looks:
        """How light and surfaces are drawn."""
        from tomo.draw.emission import Looks

        return Looks(tuple(self.level or ()), self.colormap)

    def titled(self, name: str) -> str:
        """Return the title, that of a file if none was given."""
        return name if self.title is None else self.title


def parse_grid_shape(text: str) -> tuple[int, int, int]:
    """Return the counts of ``30x140x30``."""
    match = re.fullmatch(r"(\d{1,9})x(\d{1,9})x(\d{1,9})", text.strip().lower(), re.ASCII)
    if match is None:
        raise ValueError(
            f"--grid: found {text!r}, expected three counts like 30x140x30, below 10^9"
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


def parse_spacing(text: str) -> tuple[float, float, float]:
    """Return the edge lengths of ``0.5`` or ``0.5,0.5,1``."""
    numbers = _numbers(text)
    if numbers is None or len(numbers) not in (1, 3) or min(numbers) <= 0:
        raise ValueError(f"--spacing: found {text!r}, expected lengths like 0.5 or 0.5,0.5,1")
    x, y, z = numbers * (3 // len(numbers))
    return x, y, z


def _numbers(text: str) -> list[float] | None:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return None
    return numbers if all(math.isfinite(number) for number in numbers) else None


def read_volume_file(path: Path, array: BareArray, *, allow_nan: bool = False) -> Volume:
    """Return a volume."""
    from tomo.io import read_volume

    given = {
        "spacing": parse_spacing(array.spacing) if array.spacing else None,
        "center": parse_triple(array.center, "--center") if array.center else None,
        "length_unit": array.length_unit,
    }
    return read_volume(path, allow_nan=allow_nan, **given)[0]


def read_volume_in(path: Path, rig: Rig, box: Box) -> Volume:
    """Return a volume in a rig's unit of length."""
    if path.suffix.lower() == ".npy":
        return read_volume_file(path, BareArray(box.spacing, box.center, rig.length_unit))
    found = read_volume_file(path, BareArray())
    if found.length_unit != rig.length_unit:
        raise ValueError(
            f"{path}: length_unit: found {found.length_unit!r}, expected {rig.length_unit!r}, the "
            "rig's"
        )
    return found


def load_rig_and_grid(text: str) -> tuple[Rig, VoxelGrid | None]:
    """Return the rig of a preset, a scan or a file of any format, and the grid that it names."""
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


def check_output_folder(folder: Path) -> None:
    """Raise unless the folder exists or can be made; remove what killed runs left in it."""
    existing = folder.absolute()
    while not existing.exists():
        existing = existing.parent
    if not existing.is_dir():
        raise NotADirectoryError(f"{existing}: is a file, expected a folder to write into")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise PermissionError(f"{existing}: nothing can be written there")
    if folder.exists():
        from rigs.files import remove_leftovers

        remove_leftovers(folder)


def check_output_file(path: Path, suffixes: Sequence[str] = ()) -> None:
    """Raise unless a file of one of the suffixes, if any are named, can be written there."""
    if suffixes and path.suffix.lower() not in suffixes:
        expected = suffixes[0] if len(suffixes) == 1 else f"one of {', '.join(suffixes)}"
        raise ValueError(f"{path}: suffix: found {path.suffix!r}, expected {expected}")
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a folder, expected a file to write")
    check_output_folder(path.parent)


def check_output_pictures(paths: Iterable[Path], *more: str) -> None:
    """Raise unless every path is that of a picture that can be written."""
    for path in paths:
        check_output_file(path, (*PICTURE_SUFFIXES, *more))


def check_output_volume(folder: Path, rig: Rig, source: object) -> None:
    """Raise unless volumes in the unit of a rig from ``source`` can be written into the folder."""
    check_output_folder(folder)
    _check_length_unit(rig, source)


def check_output_store(path: Path, rig: Rig, source: object) -> None:
    """Raise unless a store in the unit of a rig from ``source`` can be written there."""
    from tomo.series.layout import SUFFIX

    if path.suffix != SUFFIX:
        raise ValueError(
            f"-o: found {str(path)!r}, expected a store like out{SUFFIX} with --frames"
        )
    if path.is_file():
        raise FileExistsError(f"{path}: is a file, expected a store to write")
    check_output_folder(path.parent)
    _check_length_unit(rig, source)


def _check_length_unit(rig: Rig, source: object) -> None:
    from tomo.io.volumes import check_length_unit

    try:
        check_length_unit(rig.length_unit)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
