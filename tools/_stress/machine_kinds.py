"""The kinds of files that there are, each with its writer and with what tells its version."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from _stress import machine_rig_kinds
from _stress.machine_kind import Kind, versions
from _stress.machine_rig_kinds import rig_of, versions_of

EDGE = 48
"""Of the volumes and images: large enough to be killed in the middle of."""


def _volumes(suffix: str) -> Kind:
    from tomo import VoxelGrid
    from tomo.io import read_volume, write_volume

    grid = VoxelGrid((EDGE, EDGE, EDGE), 0.5)
    texture = np.random.default_rng(0).random(grid.shape).astype(np.float32) / 2

    def write(folder: Path, _: None, version: int) -> None:
        write_volume(folder / f"volume{suffix}", texture + version, grid, "mm")

    return Kind(write, lambda folder: versions(read_volume(folder / f"volume{suffix}")[0]))


def _images(suffix: str) -> Kind:
    from tomo.io import read_image, write_image

    def write(folder: Path, _: None, version: int) -> None:
        write_image(folder / f"image{suffix}", np.full((600, 800), version, np.uint16))

    def read(folder: Path) -> set[int]:
        return versions(read_image(folder / f"image{suffix}") * 65535 + 0.01)

    return Kind(write, read)


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

    from tomo.wernet import load_encoder, save_encoder
    from tomo.wernet.default import CorrectionEncoder

    def write(folder: Path, encoder: CorrectionEncoder, version: int) -> None:
        with torch.no_grad():
            for parameter in encoder.parameters():
                parameter.fill_(version)
        save_encoder(encoder, folder / "encoder.pt")

    def read(folder: Path) -> set[int]:
        found = load_encoder(folder / "encoder.pt").parameters()
        return set().union(*(versions(one.detach().numpy()) for one in found))

    return Kind(write, read, CorrectionEncoder)


def _checkpoint() -> Kind:
    from tomo.selection import Choice
    from tomo.wernet.default.checkpoint import Checkpoint, State

    def write(folder: Path, _: None, version: int) -> None:
        volume = np.full(EDGE**3, version, np.float32)
        state = State(version, volume, Choice("nnls", 1.0, 9, 0.1), None, 1.0, "", {})
        Checkpoint(folder / "checkpoint.pt", "problem").save(state)

    def read(folder: Path) -> set[int]:
        state = Checkpoint(folder / "checkpoint.pt", "problem").load()
        return {state.round} | versions(state.volume)

    return Kind(write, read)


def _cache() -> Kind:
    from rigs.calibrate.detect import _detection_cache
    from rigs.calibrate.detect.found import Found

    def write(folder: Path, _: None, version: int) -> None:
        found = Found(np.arange(60), np.full((60, 2), float(version)), float(version))
        entries = {f"image {n}": (found, (640, 480)) for n in range(300)}
        _detection_cache.write(folder / "seen", entries)

    def read(folder: Path) -> set[int]:
        entries = _detection_cache.read(folder / "seen")
        return set().union(*(versions(found.uv) for found, _ in entries.values()))

    return Kind(write, read)


def _scan() -> Kind:
    from tomo import Scan, VoxelGrid
    from tomo.io import read_volume
    from tomo.scan import save_scan

    def write(folder: Path, _: None, version: int) -> None:
        rig = rig_of(6, version)
        images = {name: np.full((60, 80), version, np.float32) for name in rig.names}
        grid = VoxelGrid((4, 4, 4), 1.0)
        truth = np.full(grid.shape, version, np.float32)
        save_scan(folder / "scan", rig, {"0001": images}, grid=grid, truth=truth)

    def read(folder: Path) -> set[int]:
        if not (folder / "scan" / "scan.yaml").exists():
            return set()
        scan = Scan.load(folder / "scan")
        images = (versions(image) for image in scan.images())
        return versions_of(scan.rig).union(versions(read_volume(scan.truth)[0]), *images)

    return Kind(write, read, tells=True)


def _outcome() -> Kind:
    """Pictures are drawn once: the writing of files is what has to be killed."""
    from _stress.machine_commands import small_scan
    from tomo.io import read_volume
    from tomo.report import outcome_files

    def prepare() -> Any:
        from tomo import Scan
        from tomo.pipeline import reconstruct

        with tempfile.TemporaryDirectory() as folder:
            scan = Scan.load(small_scan(Path(folder)))
            outcome = reconstruct(scan, method="sirt", iterations=2)
        return outcome, outcome_files.draw(outcome_files.results_of(outcome))

    def write(folder: Path, prepared: Any, version: int) -> None:
        outcome, pictures = prepared
        found = outcome.reconstruction
        flat = replace(found, volume=np.full(found.grid.shape, version, np.float32))
        told = {**outcome.settings, "seed": version}
        with patch.object(outcome_files, "draw", lambda *_: pictures):
            outcome_files.write_outcome(
                folder / "out", replace(outcome, reconstruction=flat, settings=told)
            )

    def read(folder: Path) -> set[int]:
        out = folder / "out"
        if not (out / "report.json").exists():
            return set()
        found = {json.loads((out / "report.json").read_text("utf-8"))["seed"]}
        return found.union(
            *(versions(read_volume(out / f"volume.{one}")[0]) for one in ("npz", "vti", "nrrd"))
        )

    return Kind(write, read, prepare, tells=True)


KINDS: dict[str, Callable[[], Kind]] = {
    "npz": lambda: _volumes(".npz"),
    "vti": lambda: _volumes(".vti"),
    "nrrd": lambda: _volumes(".nrrd"),
    "tif": lambda: _images(".tif"),
    "png": lambda: _images(".png"),
    "rig": machine_rig_kinds.rig,
    "COLMAP model": machine_rig_kinds.model,
    "ray table": machine_rig_kinds.ray_table,
    "page": machine_rig_kinds.page,
    "meshes": machine_rig_kinds.meshes,
    "figures": _figures,
    "encoder": _encoder,
    "checkpoint": _checkpoint,
    "cache": _cache,
    "scan": _scan,
    "outcome": _outcome,
}
"""Called in the process that writes; foreign formats of one file are written as ``rig`` is."""
