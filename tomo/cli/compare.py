"""``flametomo compare``: two volumes beside each other, in figures and on a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tomo.cli.console import print_json, say
from tomo.cli.inputs import BareArray, check_output_file, read_volume_file

if TYPE_CHECKING:
    from tomo import Volume

EXAMPLES = """
flametomo compare out other -o compare.html
flametomo compare scan/truth.npz out --json
flametomo compare out.zarr out.zarr --frame-a 0 --frame-b 20 -o frames.html
flametomo compare out array.npy --spacing 0.5
"""


def compare(
    a: Path,
    b: Path,
    /,
    *,
    out: Path | None = None,
    frame_a: int | None = None,
    frame_b: int | None = None,
    json: bool = False,
    array: BareArray,
) -> None:
    """Compare two volumes: figures, slices beside each other and their difference.

    B on another grid is resampled onto that of A, which is said.

    Parameters
    ----------
    a : A
        What reconstruct wrote (a folder or a store), a volume file, or a film of volumes. Its
        grid is that of the comparison.
    b : B
        The same, to compare with A.
    out : FILE
        A .html page to write.
    frame_a : N
        Frame of A, counted from 0, where it is a film of several.
    frame_b : N
        Frame of B, counted from 0, where it is a film of several.
    """
    if out is not None:
        check_output_file(out, (".html",))
    from tomo.report.volume_comparison import VolumeComparison

    if array != BareArray() and ".npy" not in (a.suffix.lower(), b.suffix.lower()):
        raise ValueError(
            "--spacing, --center, --length-unit: found with volumes that have a grid, expected "
            "with a .npy alone"
        )
    first, second = (
        _volume(path, frame, option, array)
        for path, frame, option in ((a, frame_a, "--frame-a"), (b, frame_b, "--frame-b"))
    )
    names = _names((a, b), (frame_a, frame_b))
    found = VolumeComparison.of(first, second, names)
    if out is not None:
        found.write(out)
    for note in found.notes:
        say(f"note: {note}", "yellow")
    shown = {
        "NRMSE": found.figures["nrmse"],
        "cosine distance": found.figures["cosine_distance"],
        "PSNR in dB": found.figures["psnr"],
        "SSIM": found.figures["ssim"],
        "total, B over A": found.figures["total_ratio"],
        "peak, B over A": found.figures["peak_ratio"],
    }
    for name, value in shown.items():
        say(f"{name}: {'none' if value is None else f'{value:.4g}'}")
    if out is not None:
        say(f"{out}: the page")
    if json:
        print_json(found.figures | {"page": None if out is None else str(out)})


def _volume(path: Path, frame: int | None, option: str, array: BareArray) -> Volume:
    """Return the volume of an outcome's folder, a film's frame, or a volume file."""
    from tomo.io import VolumeFilm
    from tomo.report.outcome_files import VOLUME_FILES
    from tomo.series import SeriesStore

    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    if path.suffix != ".zarr":
        if frame is not None:
            raise ValueError(f"{option}: found {frame}, expected it with a film like out.zarr")
        if path.is_dir():
            path = path / VOLUME_FILES[0]
        own = array if path.suffix.lower() == ".npy" else BareArray()
        return read_volume_file(path, own, allow_nan=True)
    film = VolumeFilm(path) if VolumeFilm.is_at(path) else SeriesStore(path)
    if frame is None and film.n_frames > 1:
        raise ValueError(
            f"{path}: found {film.n_frames} frames, expected one: {option} N names it, from 0"
        )
    place = frame or 0
    if not 0 <= place < film.n_frames:
        raise ValueError(
            f"{option}: found {place}, expected 0 to {film.n_frames - 1}, a frame of {path}"
        )
    return film.read(place) if isinstance(film, VolumeFilm) else film.volume(place)


def _names(paths: tuple[Path, Path], frames: tuple[int | None, int | None]) -> tuple[str, str]:
    """Return names that differ: those of file or folder, with the frame; paths if need be."""
    added = ["" if frame is None else f", frame {frame}" for frame in frames]
    short = [path.absolute().name + more for path, more in zip(paths, added, strict=True)]
    long = [str(path) + more for path, more in zip(paths, added, strict=True)]
    first, second = long if short[0] == short[1] else short
    return (first, second) if first != second else (f"A: {first}", f"B: {second}")
