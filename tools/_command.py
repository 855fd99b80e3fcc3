"""What every command shares: bad input is one line and exit code 2; progress is on stderr."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import rich.console
import typer
from _entry import was_asked_to_stop

if TYPE_CHECKING:
    from rigs import Rig
    from tomo import VoxelGrid

console = rich.console.Console(stderr=True)

_ABOUT_A_PATH = (
    FileNotFoundError,
    FileExistsError,
    IsADirectoryError,
    NotADirectoryError,
    PermissionError,
)


@contextmanager
def bad_input_in_one_line() -> Iterator[None]:
    """Turn errors about input, memory and files into one line on stderr.

    Exit codes are 2 for input, which is what takes too much memory too, and 1 for files that the
    system refuses to read or write (a full disk) and for what diverged.
    """
    from tomo._compute.memory import check_address_space

    try:
        check_address_space()
        yield
    except Exception as error:
        if was_asked_to_stop() or isinstance(error, BrokenPipeError):
            raise  # for `run` and for typer to say
        if isinstance(error, (ValueError, *_ABOUT_A_PATH)):
            _end(f"error: {_told(error)}", 2)
        if isinstance(error, (OSError, FloatingPointError)):
            is_input = getattr(error, "errno", None) == errno.ENAMETOOLONG
            _end(f"error: {_told(error)}", 2 if is_input else 1)
        if not _for_want_of_memory(error):
            raise
        _end(
            f"error: memory: found too little left, expected enough: use fewer voxels, smaller "
            f"images or another method ({_told(error)})",
            2,
        )


def _end(line: str, code: int) -> NoReturn:
    typer.echo(line, err=True)
    raise typer.Exit(code) from None


def _told(error: Exception) -> str:
    """Return what an error says in one line; the file first where the system names one."""
    said = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        said = f"{error.filename}: {error.strerror}"
    return " ".join(said.split()) or type(error).__name__


def _for_want_of_memory(error: BaseException) -> bool:
    """Tell whether it is memory that lacked: libraries say so in words of their own."""
    words = ("allocate memory", "out of memory", "failed to map segment", "start new thread")
    if not isinstance(error, (RuntimeError, ImportError)):
        return isinstance(error, MemoryError)
    return any(word in str(error).lower() for word in words)


def check_output_folder(folder: Path) -> None:
    """Raise unless there is such a folder or it can be made: better now than after the work.

    What killed runs left half-written in it is removed.
    """
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


def check_output_volume(folder: Path, rig: Rig, source: object) -> None:
    """Raise unless volumes in the unit of a rig from ``source`` can be written into the folder."""
    from tomo.io.volumes import check_length_unit

    check_output_folder(folder)
    try:
        check_length_unit(rig.length_unit)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


def print_json(result: dict) -> None:
    """Print one JSON object on stdout."""
    sys.stdout.write(json.dumps(result, indent=2) + "\n")


def finite_or_none(value: float) -> float | None:
    """Return a figure as JSON holds it: None for what is no finite number."""
    return value if math.isfinite(value) else None


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[int, int, str], None]]:
    """Show a bar on stderr; call what is yielded with done, total and a word on where it is."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f}%"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[where]}"),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(what, total=None, where="")

        def show(done: int, total: int, where: str = "") -> None:
            progress.update(task, completed=done, total=total, where=where)

        yield show


def parse_grid_shape(text: str, option: str = "--grid") -> tuple[int, int, int]:
    """Return the counts of ``30x140x30``."""
    match = re.fullmatch(r"(\d{1,9})x(\d{1,9})x(\d{1,9})", text.strip().lower(), re.ASCII)
    if match is None:
        raise ValueError(
            f"{option}: found {text!r}, expected three counts like 30x140x30, below 10^9"
        )
    return tuple(int(n) for n in match.groups())


def parse_triple(text: str, option: str) -> tuple[float, float, float]:
    """Return the numbers of ``x,y,z``; they may start with a minus sign."""
    numbers = _numbers(text)
    if numbers is None or len(numbers) != 3:
        raise ValueError(f"{option}: found {text!r}, expected three numbers like -1.5,0,2")
    return tuple(numbers)


def parse_spacing(text: str, option: str = "--spacing") -> tuple[float, float, float]:
    """Return the edge lengths of ``0.5`` or ``0.5,0.5,1``."""
    numbers = _numbers(text)
    if numbers is None or len(numbers) not in (1, 3) or min(numbers) <= 0:
        raise ValueError(f"{option}: found {text!r}, expected lengths like 0.5 or 0.5,0.5,1")
    return tuple(numbers * (3 // len(numbers)))


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
    """Return the grid that options name; what they leave out is as in ``default``.

    Either ``lower`` and ``upper`` with a shape, or any of shape, spacing and center.
    """
    from tomo import VoxelGrid

    if lower is not None or upper is not None:
        given = {"--lower": lower, "--upper": upper, "--spacing": spacing, "--center": center}
        found = [name for name, value in given.items() if value is not None]
        if found != ["--lower", "--upper"]:
            raise ValueError(
                f"--lower and --upper: found {', '.join(found)}, expected both, with --grid's "
                "counts and neither --spacing nor --center"
            )
        shape = parse_grid_shape(shape) if shape else default and default.shape
        if shape is None:
            raise ValueError("--grid: found none, expected counts like 30x140x30")
        bounds = parse_triple(lower, "--lower"), parse_triple(upper, "--upper")
        return VoxelGrid.from_bounds(shape, *bounds)
    if default is None and (shape is None or spacing is None):
        raise ValueError(
            "--grid and --spacing: expected both, like --grid 30x140x30 --spacing 0.5, "
            "as neither scan nor rig says where the volume is"
        )
    return VoxelGrid(
        parse_grid_shape(shape) if shape else default.shape,
        parse_spacing(spacing) if spacing else default.spacing,
        parse_triple(center, "--center") if center else default.center if default else (0, 0, 0),
    )


def load_rig_or_preset(text: str) -> Rig:
    """Return the rig of a preset, a scan, or a file or folder of any known format."""
    return load_rig_and_grid(text)[0]


def load_rig_and_grid(text: str) -> tuple[Rig, VoxelGrid | None]:
    """Return such a rig and the voxels that the scan, or the rig itself, names; None for none."""
    from rigs import formats, preset, preset_names
    from tomo.grid import grid_of_rig

    path, grid = Path(text), None
    files = [path / name for name in ("transforms.json", "rig.yaml") if (path / name).is_file()]
    if text in preset_names():
        rig = preset(text)
    elif (path.is_file() and path.name == "scan.yaml") or (path / "scan.yaml").is_file():
        from tomo import Scan

        scan = Scan.load(path)
        rig, grid = scan.rig, scan.grid
    elif path.exists():
        rig = formats.load(files[0] if files else path)
    else:
        known = ", ".join(preset_names())
        raise FileNotFoundError(f"{text}: no such rig file, and no preset; presets are {known}")
    return rig, grid or grid_of_rig(rig)
