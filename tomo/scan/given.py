"""What a program may give for a scan: a scan, a path, or the images of cameras."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.scan.files import load_scan
from tomo.scan.image_folder import scan_of_images
from tomo.scan.scan import Scan


def as_scan(
    given: Scan | str | PathLike | Mapping[str, Any] | Any,
    rig: Rig | str | PathLike | None = None,
    grid: VoxelGrid | None = None,
) -> Scan:
    """Return the scan that is given, loaded from a path, or made of images in memory.

    Parameters
    ----------
    given : Scan, path-like, mapping, Dataset or DataArray
        A path is that of a scan, or with ``rig`` of a folder of images; a mapping is camera to
        image, see `Scan.from_arrays`, and needs ``rig``.
    rig : Rig or path-like, optional
        The cameras of images.
    grid : VoxelGrid, optional
        The grid of a scan of images.

    Raises
    ------
    ValueError
        If there is a rig beside a scan, or none beside images; else as the loaders raise.
    """
    if isinstance(given, Scan):
        if rig is not None:
            raise ValueError(f"{given.where}rig: found one, expected none beside a scan's own")
        return given
    settings = {} if grid is None else {"grid": grid}
    if isinstance(given, str | PathLike):
        return load_scan(given) if rig is None else scan_of_images(rig, given, **settings)
    if not (isinstance(given, Mapping) or hasattr(given, "dims")):
        raise ValueError(
            f"scan: found {type(given).__name__}, expected a Scan, a path, or camera to image"
        )
    if rig is None:
        raise ValueError("rig: found none, expected the rig of the images: rig=...")
    if not isinstance(rig, Rig):
        from rigs import load

        rig = load(rig)
    return Scan.from_arrays(rig, given, **settings)


def scan_again(source: Path, origin: Mapping[str, Any]) -> Scan:
    """Return the scan that was loaded from a file or folder, which may have moved.

    Parameters
    ----------
    source : Path
        The scan, or the folder of its images.
    origin : mapping
        `Scan.origin`: the ``rig`` file of a folder of images and their ``pattern``; the folder of
        ``images`` of a transforms.json; the ``corrections`` that were given.

    Raises
    ------
    ValueError, FileNotFoundError
        As the loaders raise.
    """
    if "rig" in origin:
        rig = Path(origin["rig"])
        beside = source.parent / rig.name
        scan = scan_of_images(
            beside if beside.exists() and not rig.exists() else rig, source, origin.get("pattern")
        )
    else:
        scan = load_scan(source, origin.get("images"))
    given = origin.get("corrections")
    return scan.with_corrections(**given) if given else scan
