"""The kinds of files that there are, each with its writer and with what tells its version."""

from __future__ import annotations

import json
import re
import struct
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

if TYPE_CHECKING:
    from rigs import Rig
    from tomo.view.scene import Scene

EDGE = 48
"""Of the volumes and images: large enough to be killed in the middle of."""


@dataclass(frozen=True)
class Kind:
    """How one kind of file is written and read.

    Attributes
    ----------
    prepare : callable
        ``prepare()`` returns what writing needs; done once, in a fork.
    tells : bool
        Whether what stands there can say that it is not complete.
    write : callable
        ``write(folder, prepared, version)``.
    read : callable
        ``read(folder)`` returns every version that it finds in what stands under final names;
        none where that says that it is not complete.
    """

    write: Callable[[Path, Any, int], object]
    read: Callable[[Path], set[int]]
    prepare: Callable[[], Any] = lambda: None
    tells: bool = False


def _volumes(suffix: str) -> Kind:
    from tomo import VoxelGrid
    from tomo.io import read_volume, write_volume

    grid = VoxelGrid((EDGE, EDGE, EDGE), 0.5)
    texture = np.random.default_rng(0).random(grid.shape).astype(np.float32) / 2

    def write(folder: Path, _: None, version: int) -> None:
        write_volume(folder / f"volume{suffix}", texture + version, grid, "mm")

    return Kind(write, lambda folder: _versions(read_volume(folder / f"volume{suffix}")[0]))


def _images(suffix: str) -> Kind:
    from tomo.io import read_image, write_image

    def write(folder: Path, _: None, version: int) -> None:
        write_image(folder / f"image{suffix}", np.full((600, 800), version, np.uint16))

    def read(folder: Path) -> set[int]:
        return _versions(read_image(folder / f"image{suffix}") * 65535 + 0.01)

    return Kind(write, read)


def _rig() -> Kind:
    from rigs import load_rig, save_rig

    def write(folder: Path, _: None, version: int) -> None:
        save_rig(_rig_of(24, version), folder / "rig.yaml")

    def read(folder: Path) -> set[int]:
        rig = load_rig(folder / "rig.yaml")
        return _versions_of(rig)

    return Kind(write, read)


def _rig_of(views: int, version: int) -> Rig:
    """Return a rig whose cameras' distance tells the version."""
    from rigs import ring

    return ring(views, distance=100.0 + version, image_size=(80, 60), footprint=0.5)


def _versions_of(rig: Rig) -> set[int]:
    return {round(float(np.linalg.norm(camera.position))) - 100 for camera in rig}


def _model() -> Kind:
    """Write a model of COLMAP: several files, whose cameras' lenses tell the version too."""
    import yaml  # noqa: F401  before there are forks

    from rigs.formats import colmap

    def write(folder: Path, _: None, version: int) -> None:
        colmap.save(_rig_of(24, version), folder)

    def read(folder: Path) -> set[int]:
        if not (folder / "cameras.txt").exists():
            return set()
        rig = colmap.load(folder)
        lenses = {round(0.5 * camera.camera_matrix[0, 0]) - 100 for camera in rig}
        return lenses | _versions_of(rig)

    return Kind(write, read, tells=True)


def _ray_table() -> Kind:
    from rigs import RayTable
    from rigs.ray_file import load_ray_table, save_ray_table

    looking = np.broadcast_to([0.0, 0.0, 1.0], (480, 640, 3))

    def write(folder: Path, _: None, version: int) -> None:
        save_ray_table(RayTable("camera", [version, 0, 0], looking), folder / "rays.npz")

    def read(folder: Path) -> set[int]:
        return _versions(load_ray_table("camera", "rays.npz", folder).own_origins[..., 0])

    return Kind(write, read)


def _page() -> Kind:
    import plotly.graph_objects  # noqa: F401  before there are forks

    from tomo.view import write_html

    def write(folder: Path, scene: Scene, version: int) -> None:
        write_html(folder / "page.html", scene, title=f"version {version}")

    def read(folder: Path) -> set[int]:
        text = (folder / "page.html").read_text("utf-8")
        named = set(map(int, re.findall(r"<title>version (\d+)", text)))
        return named if text.rstrip().endswith("</html>") else {-1}

    return Kind(write, read, _scene)


def _meshes() -> Kind:
    import trimesh  # noqa: F401  before there are forks

    from tomo.view import write_glb

    def write(folder: Path, scene: Scene, version: int) -> None:
        named = [replace(mesh, group=f"version {version}") for mesh in scene.meshes]
        write_glb(folder / "scene.glb", replace(scene, meshes=tuple(named)))

    def read(folder: Path) -> set[int]:
        data = (folder / "scene.glb").read_bytes()
        (length,) = struct.unpack("<I", data[8:12])
        named = set(map(int, re.findall(rb"version (\d+)", data)))
        return named if length == len(data) else {-1}

    return Kind(write, read, _scene)


def _scene() -> Scene:
    from tomo.view import rig_scene

    return rig_scene(_rig_of(6, 1)).without("stems")


def _figures() -> Kind:
    """Write what studies, and the stress test itself, go on from."""
    from _results import write_json

    def write(folder: Path, _: None, version: int) -> None:
        write_json(folder / "figures.json", [version] * 50_000)

    def read(folder: Path) -> set[int]:
        found = json.loads((folder / "figures.json").read_text("utf-8"))
        return set(found) if len(found) == 50_000 else {-1}

    return Kind(write, read)


def _encoder() -> Kind:
    import torch

    from tomo.wernet import CorrectionEncoder, load_encoder, save_encoder

    def write(folder: Path, encoder: CorrectionEncoder, version: int) -> None:
        with torch.no_grad():
            for parameter in encoder.parameters():
                parameter.fill_(version)
        save_encoder(encoder, folder / "encoder.pt")

    def read(folder: Path) -> set[int]:
        found = load_encoder(folder / "encoder.pt").parameters()
        return set().union(*(_versions(one.detach().numpy()) for one in found))

    return Kind(write, read, CorrectionEncoder)


def _checkpoint() -> Kind:
    from tomo.solve.stopping import Choice
    from tomo.wernet._checkpoint import Checkpoint, State

    def write(folder: Path, _: None, version: int) -> None:
        volume = np.full(EDGE**3, version, np.float32)
        state = State(version, volume, Choice("nnls", 1.0, 9, 0.1), None, 1.0, "", {})
        Checkpoint(folder / "checkpoint.pt", "problem").save(state)

    def read(folder: Path) -> set[int]:
        state = Checkpoint(folder / "checkpoint.pt", "problem").load()
        return {state.round} | _versions(state.volume)

    return Kind(write, read)


def _cache() -> Kind:
    from rigs.calibrate import _detection_cache
    from rigs.calibrate._found import Found

    def write(folder: Path, _: None, version: int) -> None:
        found = Found(np.arange(60), np.full((60, 2), float(version)), float(version))
        entries = {f"image {n}": (found, (640, 480)) for n in range(300)}
        _detection_cache.write(folder / "seen", entries)

    def read(folder: Path) -> set[int]:
        entries = _detection_cache.read(folder / "seen")
        return set().union(*(_versions(found.uv) for found, _ in entries.values()))

    return Kind(write, read)


def _scan() -> Kind:
    from tomo import Scan, VoxelGrid
    from tomo.io import read_volume
    from tomo.scan_file import save_scan

    def write(folder: Path, _: None, version: int) -> None:
        rig = _rig_of(6, version)
        images = {name: np.full((60, 80), version, np.float32) for name in rig.names}
        grid = VoxelGrid((4, 4, 4), 1.0)
        truth = np.full(grid.shape, version, np.float32)
        save_scan(folder / "scan", rig, {"0001": images}, grid=grid, truth=truth)

    def read(folder: Path) -> set[int]:
        if not (folder / "scan" / "scan.yaml").exists():
            return set()
        scan = Scan.load(folder / "scan")
        images = (_versions(image) for image in scan.images())
        return _versions_of(scan.rig).union(_versions(read_volume(scan.truth)[0]), *images)

    return Kind(write, read, tells=True)


def _outcome() -> Kind:
    """Pictures are drawn once: the writing of files is what has to be killed."""
    from _stress.machine_commands import small_scan
    from tomo.io import read_volume
    from tomo.view import outcome_files

    def prepare() -> Any:
        from tomo import Scan
        from tomo.reconstruct import reconstruct

        with tempfile.TemporaryDirectory() as folder:
            scan = Scan.load(small_scan(Path(folder)))
            outcome = reconstruct(scan, method="sirt", iterations=2)
        return outcome, outcome_files.draw(outcome_files.results_of(outcome))

    def write(folder: Path, prepared: Any, version: int) -> None:
        outcome, pictures = prepared
        found = outcome.reconstruction
        flat = replace(found, volume=np.full(found.grid.shape, version, np.float32))
        told = {**outcome.settings, "seed": version}
        with patch.object(outcome_files, "draw", lambda _: pictures):
            outcome_files.write_outcome(
                folder / "out", replace(outcome, reconstruction=flat, settings=told)
            )

    def read(folder: Path) -> set[int]:
        out = folder / "out"
        if not (out / "report.json").exists():
            return set()
        found = {json.loads((out / "report.json").read_text("utf-8"))["seed"]}
        return found.union(
            *(_versions(read_volume(out / f"volume.{one}")[0]) for one in ("npz", "vti", "nrrd"))
        )

    return Kind(write, read, prepare, tells=True)


def _versions(values: np.ndarray) -> set[int]:
    return {int(value) for value in np.unique(np.floor(values))}


KINDS: dict[str, Callable[[], Kind]] = {
    "npz": lambda: _volumes(".npz"),
    "vti": lambda: _volumes(".vti"),
    "nrrd": lambda: _volumes(".nrrd"),
    "tif": lambda: _images(".tif"),
    "png": lambda: _images(".png"),
    "rig": _rig,
    "COLMAP model": _model,
    "ray table": _ray_table,
    "page": _page,
    "meshes": _meshes,
    "figures": _figures,
    "encoder": _encoder,
    "checkpoint": _checkpoint,
    "cache": _cache,
    "scan": _scan,
    "outcome": _outcome,
}
"""Called in the process that writes; foreign formats of one file are written as ``rig`` is."""
