"""A volume file a frame: a folder of NumPy files, and ParaView's collections of .vti files."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

from rigs.files import atomic_path
from tomo.export.export import Frames
from tomo.io import write_volume


def write_npz(frames: Frames, folder: Path) -> None:
    """Write a NumPy file a frame into a folder."""
    _write_files(frames, folder, ".npz")


def write_pvd(frames: Frames, target: Path) -> None:
    """Write a ParaView collection, and the .vti files that it names in a folder beside it."""
    folder = target.with_name(f"{target.stem}_frames")
    files = _write_files(frames, folder, ".vti")
    lines = [
        f'    <DataSet timestep="{float(time)!r}" part="0" '
        f"file={quoteattr(f'{folder.name}/{file.name}')}/>"
        for time, file in zip(frames.times, files, strict=True)
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


def _write_files(frames: Frames, folder: Path, suffix: str) -> list[Path]:
    """Write a volume file a frame, named by its number in the scan; return them."""
    about, files = frames.store.attributes, []
    for number, volume in zip(frames.numbers, frames.volumes(), strict=True):
        files.append(folder / f"frame_{number:06d}{suffix}")
        write_volume(
            files[-1],
            volume,
            frames.store.grid,
            about["length_unit"],
            value_unit=about["value_unit"],
            allow_nan=True,
        )
    return files
