"""Write one kind of file in a process that is killed at random, and read what is left.

``python -m _stress.machine_writers KIND FOLDER TIMES SEED`` prints what was wrong as JSON. Each
writer is a fork of this process, which itself starts no threads.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

if TYPE_CHECKING:
    from rigs import Rig

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
    "encoder": _encoder,
    "checkpoint": _checkpoint,
    "cache": _cache,
    "scan": _scan,
    "outcome": _outcome,
}


def kill_at_random(kind: Kind, folder: Path, times: int, seed: int) -> dict[str, Any]:
    """Kill so many writers, each over what the one before left; return what came of it.

    Returns
    -------
    dict
        ``faults``, and how many ``left`` a temporary file, were done (``new``), or were
        ``between``: stopped while files were moved, which the folder says.
    """
    from tomo.io import remove_leftovers

    random = np.random.default_rng(seed)
    prepared = _in_fork(kind.prepare)
    code, seconds = _write(kind, prepared, folder, 1, None)
    if code:
        raise SystemExit("the first writer fails")
    good, faults, left, new, between = 1, [], 0, 0, 0
    for version in range(2, times + 2):
        _write(kind, prepared, folder, version, seconds * random.uniform(0.0, 1.0))
        try:
            found = kind.read(folder)
        except Exception as error:  # half a file may raise anything
            faults.append(f"not to be read: {type(error).__name__}: {error}"[:100])
            continue
        if len(found) > 1 or not found <= {good, version} or (not found and not kind.tells):
            faults.append(f"found versions {sorted(found)} for {good} or {version}")
        between += not found and good > 0
        new += version in found
        good = max(found, default=0)
        left += bool(_partial(folder))
    remove_leftovers(folder)
    code, _ = _write(kind, prepared, folder, times + 2, None)
    if code or kind.read(folder) != {times + 2}:
        faults.append("the next writer fails")
    if _partial(folder):
        faults.append(f"the next writer leaves {_partial(folder)[0]}")
    return {"faults": faults, "left": left, "new": new, "between": between}


def _partial(folder: Path) -> list[str]:
    return [path.name for path in folder.rglob(".*") if ".partial-" in path.name]


def _in_fork(make: Callable[[], Any]) -> Any:
    """Return what ``make`` returns in a fork: the threads that it starts stay there."""
    with tempfile.TemporaryFile() as file:
        code = _wait(_fork(lambda: (pickle.dump(make(), file), file.flush())))
        if code:
            raise SystemExit("what is to be written cannot be made")
        file.seek(0)
        return pickle.load(file)


def _write(
    kind: Kind, prepared: Any, folder: Path, version: int, seconds: float | None
) -> tuple[int, float]:
    """Write in a fork, killed after ``seconds``; return its exit code and how long it wrote."""
    began = time.perf_counter()
    writer = _fork(lambda: kind.write(folder, prepared, version))
    if seconds is not None:
        time.sleep(seconds)
        os.kill(writer, signal.SIGKILL)
    return _wait(writer), time.perf_counter() - began


def _fork(work: Callable[[], object]) -> int:
    """Return the number of a fork that does the work and ends."""
    number = os.fork()
    if number == 0:
        code = 1
        try:
            work()
            code = 0
        except BaseException:  # a fork must not go on as its parent would
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    return number


def _wait(number: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])


if __name__ == "__main__":
    result = kill_at_random(
        KINDS[sys.argv[1]](), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    )
    sys.stdout.write(json.dumps(result))
