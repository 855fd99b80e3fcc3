"""Threads and repeats: the same bits, whatever a machine has and however often one asks.

``python -m studies.stress.threads SCAN VOLUME [wernet]`` is one of the processes, with its number
of threads: it writes the volume of WERNet, or of the default method, to VOLUME (.npy), and prints
the SHA-256 of each result.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from studies.common.study import Request
from studies.common.timing import in_fresh_process
from studies.stress.row import Row, relative_error
from studies.stress.scene import Scene, jet_by, ring, scene_of, solved
from tomo import load_scan
from tomo.hull import carve
from tomo.inference.infer import infer
from tomo.measurement import estimate_noise
from tomo.model import Absorbing, Gain, Observation, Pose
from tomo.pipeline import Options, reconstruct
from tomo.simulation.effects import Effects

POOLS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
CHILD = "studies.stress.threads"


@dataclass(frozen=True, eq=False)
class Made:
    """What one process made."""

    threads: int
    hashes: Mapping[str, str]  # by name, the SHA-256 of every result
    volume: NDArray[np.float32]  # (nx, ny, nz): of the default method or of WERNet


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    quick = request.size != "full"
    counts = (1, 4, 4) if quick else (1, 2, 4, 8, 2)
    learned = (1, 2, 2) if quick else (1, 2, 4, 2)
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(2) as pool:
        classic, wernet = Path(name, "classic"), Path(name, "learned")
        _scan(classic, 9 if quick else 21, Effects())
        _scan(wernet, 6, Effects(absorption=0.3))
        # what a process does alone, importing most of all, leaves the other cores to the next
        jobs = [pool.submit(made_by, threads, classic) for threads in counts]
        jobs += [pool.submit(made_by, threads, wernet, "wernet") for threads in learned]
        made = [job.result() for job in request.each(jobs, lambda _: "processes")]
        yield from classic_rows(made[: len(counts)])
        yield from learned_rows(made[len(counts) :])


def made_by(threads: int, scan: Path, *what: str) -> Made:
    """Run the child with so many threads."""
    environment = dict.fromkeys(POOLS, str(threads))
    with tempfile.TemporaryDirectory() as folder:
        volume = Path(folder, "volume.npy")
        arguments = (str(scan), str(volume), *what)
        hashes = in_fresh_process(CHILD, *arguments, environment=environment)
        del hashes["wall_seconds"]
        return Made(threads, hashes, np.load(volume, allow_pickle=False))


def classic_rows(made: Sequence[Made]) -> Iterator[Row]:
    """Compare all processes with the first; the last has as many threads as one before it."""
    first = made[0]
    whole = [name for name in first.hashes if "@" not in name]
    over = f"{_listed(made[:-1])} threads, {len(whole)} results"
    differing = [
        f"{name}, {one.threads} threads"
        for one in made[1:-1]
        for name in whole
        if one.hashes.get(name) != first.hashes[name]
    ]
    unit = "results with other bits"
    what = "every classic method, default method, carving, effects, simulation, by threads"
    yield Row.of_faults(what, over, differing, unit=unit)
    fewer = [
        f"{name} of {one.threads}"
        for one in made
        for name, found in one.hashes.items()
        if "@" in name and found != one.hashes[name.split(" @")[0]]
    ]
    over = f"1 to {max(one.threads for one in made)} threads"
    yield Row.of_faults(
        "some of a process's threads, stored and on the fly", over, fewer, unit=unit
    )
    again = _as_the_last(made)
    repeated = [name for name in whole if again.hashes.get(name) != made[-1].hashes.get(name)]
    over = f"{made[-1].threads} threads, {len(whole)} results"
    yield Row.of_faults("the same once more, in another process", over, repeated, unit=unit)


def learned_rows(made: Sequence[Made]) -> Iterator[Row]:
    """Compare what WERNet made: the same bits on as many threads, nearly so on others."""
    again, last = _as_the_last(made), made[-1]
    differing = float(np.count_nonzero(again.volume != last.volume))
    what, over = "WERNet once more, in another process", f"{last.threads} threads"
    yield Row(what, over, differing, 0, "voxels with other bits")
    errors = [
        (f"{one.threads} threads", relative_error(one.volume, made[0].volume)) for one in made[1:]
    ]
    over, unit = f"{_listed(made[:-1])} threads", f"relative to {made[0].threads} thread"
    yield Row.of_worst("WERNet by threads", over, errors, 1e-4, unit)


def _as_the_last(made: Sequence[Made]) -> Made:
    return next(one for one in made[:-1] if one.threads == made[-1].threads)


def _scan(folder: Path, cameras: int, effects: Effects) -> None:
    noise = 0.0 if effects.any else 0.02
    jet_by(ring(cameras), noise=noise, effects=effects, seed=1).save(folder)


def _listed(made: Sequence[Made]) -> str:
    return ", ".join(str(one.threads) for one in made)


LEARNED_ROUNDS = 2

SETTINGS = (
    ("mlem", {"subsets": 4}),
    ("sirt", {"subsets": 4}),
    ("cgls", {"nonnegative": False, "strength": 1e-3}),
    ("nnls", {"nonnegative": False}),
)
"""Settings of methods that are tried in addition to their defaults."""


def main(arguments: Sequence[str]) -> None:
    """Hash what the arguments name."""
    scan, volume = map(Path, arguments[:2])
    named = dict(_learned(scan) if arguments[2:] == ["wernet"] else _classic(scan))
    np.save(volume, next(iter(named.values())))
    hashes = {name: hash_of(array) for name, array in named.items()}
    sys.stdout.write(json.dumps(hashes))


def hash_of(array: NDArray) -> str:
    """Return the SHA-256 of an array's bytes."""
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def _classic(folder: Path) -> Iterator[tuple[str, NDArray]]:
    scan = load_scan(folder)
    images, masks = scan.read()
    yield "default method", reconstruct(scan, options=Options(uncertainty=0)).solution.volume
    seen = scene_of(ring(len(scan.rig)), noise=0.02)
    yield "simulated images", np.stack(list(seen.simulated.images.values()))
    for form, projector in (("stored", seen.stored), ("on the fly", seen.on_the_fly)):
        yield f"projection, {form}", projector @ seen.truth.ravel()
        yield f"back-projection, {form}", projector.T @ seen.measured
    for name, method, projector in seen.cases():
        yield name, solved(method, projector, seen.measured, 5).volume
    for method, settings in SETTINGS:
        found = solved(method, seen.stored, seen.measured, 5, **settings)
        yield f"{method}, {', '.join(settings)}", found.volume
    yield from _fewer(seen)
    cameras = tuple(scan.rig)
    yield "carving", carve(cameras, images, masks, scan.grid).active.mask
    few = replace(scan.rig, cameras=cameras[:5])
    noise = tuple(map(estimate_noise, images[:5], masks[:5]))
    one = Observation(few, tuple(images[:5]), tuple(masks[:5]), noise, scan.grid)
    found = infer([one], (Gain(), Pose(), Absorbing(own=False)), asked=("gain", "pose", "medium"))
    for name, values in found.state.values.items():
        yield name, values


def _fewer(seen: Scene) -> Iterator[tuple[str, NDArray]]:
    """Run methods on some of the process's threads; ``mlem, stored @ 1`` has to be as all."""
    most = numba.get_num_threads()
    for threads in range(1, most):
        numba.set_num_threads(threads)
        for name, method, projector in seen.cases():
            if method in ("mlem", "nnls", "tv"):
                yield f"{name} @ {threads}", solved(method, projector, seen.measured, 5).volume
    numba.set_num_threads(most)


def _learned(folder: Path) -> Iterator[tuple[str, NDArray]]:
    found = reconstruct(
        load_scan(folder), options=Options(method="wernet", iterations=LEARNED_ROUNDS)
    )
    yield "wernet", found.solution.volume
    if found.learned is None:
        raise SystemExit("wernet learned nothing: its threads are not tried")


if __name__ == "__main__":
    main(sys.argv[1:])
