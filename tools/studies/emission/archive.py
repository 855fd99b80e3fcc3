"""The scenes as one archive for others, and the scores of others' volumes."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigs.files import atomic_path
from studies.emission.scenes import HELD, SCENES, seen
from tomo import VoxelGrid, save_scan
from tomo.io.volumes import read_volume, readable_endings

DATE = (2000, 1, 1, 0, 0, 0)
"""The date of all files of an archive: the same scenes make the same bytes."""


def write_archive(path: Path, names: Iterable[str], cache: Path, grid: VoxelGrid) -> None:
    """Write a ZIP file with a folder a scene.

    ``NAME/`` is a scan folder (``scan.yaml``, ``rig.yaml``, ``images/CAMERA/frame.tif``) with the
    truth; ``NAME/held/`` is one of the camera that judges.
    """
    with tempfile.TemporaryDirectory() as temporary:
        root = Path(temporary)
        for name in names:
            scene = seen(SCENES[name], cache, grid)
            images = dict(zip(scene.rig.names, scene.images, strict=True))
            save_scan(root / name, scene.rig, {"frame": images}, grid=grid, truth=scene.truth)
            rig = replace(scene.rig, cameras=(scene.held,))
            save_scan(root / name / HELD, rig, {"frame": {HELD: scene.held_image}}, grid=grid)
        with atomic_path(path) as place, zipfile.ZipFile(place, "w") as archive:
            for file in sorted(one for one in root.rglob("*") if one.is_file()):
                entry = zipfile.ZipInfo(file.relative_to(root).as_posix(), DATE)
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, file.read_bytes())


def scored(
    folder: Path, names: Iterable[str], cache: Path, grid: VoxelGrid
) -> list[dict[str, Any]]:
    """Return the errors of the volumes ``NAME.npy`` (or .nrrd, .vti ...) of a folder."""
    rows = []
    for name in names:
        files = [folder / (name + ending) for ending in readable_endings()]
        path = next((file for file in files if file.is_file()), None)
        if path is None:
            continue
        how = {"spacing": grid.spacing, "center": grid.center} if path.suffix == ".npy" else {}
        volume, own, _ = read_volume(path, **how)
        if own.shape != grid.shape or not np.allclose(own.lower, grid.lower, atol=1e-3):
            raise ValueError(f"{path}: grid: found {own}, expected {grid}")
        rows.append({"scene": name, **seen(SCENES[name], cache, grid).scores(np.asarray(volume))})
    if not rows:
        endings = ", ".join(readable_endings())
        raise ValueError(f"{folder}: found no volume of a scene, expected SCENE{{{endings}}}")
    return rows
