"""Stores of series as files of other programs: volume files, ParaView's collections."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from rigs.files import atomic_path
from tomo.io import write_volume
from tomo.operators.system import Progress
from tomo.series.store import SeriesStore


def export_series(
    store: SeriesStore,
    target: str | os.PathLike,
    to: str,
    places: Sequence[int] | None = None,
    *,
    progress: Progress | None = None,
) -> Path:
    """Write frames of a store for other programs, one in memory at a time.

    Parameters
    ----------
    store : SeriesStore
    target : path-like
        A folder for ``npz``, a file ``.pvd`` for ``pvd``.
    to : str
        One of `FORMATS`.
    places : sequence of int, optional
        Places of frames in the store; all when None.
    progress : callable, optional

    Raises
    ------
    ValueError
        If the format is unknown, or a frame is not complete.
    """
    if to not in FORMATS:
        raise ValueError(f"to: found {to!r}, expected one of {', '.join(FORMATS)}")
    places = range(store.n_frames) if places is None else places
    complete = store.complete
    missing = [place for place in places if not complete[place]]
    if missing:
        raise ValueError(
            f"{store.path}: frames: found {len(missing)} that are not complete, the first is "
            f"{missing[0]}: finish them by the command that began the store, or name others"
        )
    return FORMATS[to](store, Path(target), places, progress)


def _volumes(
    store: SeriesStore, places: Sequence[int], progress: Progress | None
) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """Yield places and volumes."""
    for done, place in enumerate(places):
        if progress:
            progress(done, len(places), f"frame {place}")
        yield place, store.volume(place)
    if progress:
        progress(len(places), len(places), "")


def _write_files(
    store: SeriesStore,
    folder: Path,
    suffix: str,
    places: Sequence[int],
    progress: Progress | None,
) -> list[Path]:
    """Write a volume file a frame, named by its number in the scan; return them."""
    numbers, files = store.group["frame"][:], []
    about = store.attributes
    for place, volume in _volumes(store, places, progress):
        file = folder / f"frame_{numbers[place]:06d}{suffix}"
        write_volume(
            file,
            volume,
            store.grid,
            about["length_unit"],
            value_unit=about["value_unit"],
            allow_nan=True,
        )
        files.append(file)
    return files


def _npz(
    store: SeriesStore, target: Path, places: Sequence[int], progress: Progress | None
) -> Path:
    _write_files(store, target, ".npz", places, progress)
    return target


def _pvd(
    store: SeriesStore, target: Path, places: Sequence[int], progress: Progress | None
) -> Path:
    """Write a ParaView collection, and the .vti files that it names in a folder beside it."""
    if target.suffix != ".pvd":
        raise ValueError(f"{target}: suffix: found {target.suffix!r}, expected .pvd")
    folder = target.with_name(f"{target.stem}_frames")
    files = _write_files(store, folder, ".vti", places, progress)
    times = store.group["time"][:]
    lines = [
        f'    <DataSet timestep="{float(times[place])!r}" part="0" '
        f"file={quoteattr(f'{folder.name}/{file.name}')}/>"
        for place, file in zip(places, files, strict=True)
    ]
    text = "\n".join(
        [
            '<?xml version="1.0"?>',
            '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
            "  <Collection>",
            *lines,
            "  </Collection>",
            "</VTKFile>",
            "",
        ]
    )
    with atomic_path(target) as temporary:
        temporary.write_text(text, "utf-8")
    return target


FORMATS: dict[str, Callable[[SeriesStore, Path, Sequence[int], Progress | None], Path]] = {
    "pvd": _pvd,
    "npz": _npz,
}
"""What writes each format."""
