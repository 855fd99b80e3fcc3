"""Print what every method makes of one scene, as hashes: a process with its number of threads.

``python -m studies.stress.threads_child SCAN VOLUME [wernet]`` writes the volume of WERNet, or of
the default method, to VOLUME (.npy) and a JSON object of name to SHA-256 to standard output.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from studies.stress.scene import Scene

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
    from studies.stress.scene import ring, scene_of, solved
    from tomo import load_scan
    from tomo.hull import carve
    from tomo.inference.infer import infer
    from tomo.measurement import estimate_noise
    from tomo.model import Absorbing, Gain, Observation, Pose
    from tomo.pipeline import Options, reconstruct

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
    import numba

    from studies.stress.scene import solved

    most = numba.get_num_threads()
    for threads in range(1, most):
        numba.set_num_threads(threads)
        for name, method, projector in seen.cases():
            if method in ("mlem", "nnls", "tv"):
                yield f"{name} @ {threads}", solved(method, projector, seen.measured, 5).volume
    numba.set_num_threads(most)


def _learned(folder: Path) -> Iterator[tuple[str, NDArray]]:
    from tomo import load_scan
    from tomo.pipeline import Options, reconstruct

    found = reconstruct(
        load_scan(folder), options=Options(method="wernet", iterations=LEARNED_ROUNDS)
    )
    yield "wernet", found.solution.volume
    if found.learned is None:
        raise SystemExit("wernet learned nothing: its threads are not tried")


if __name__ == "__main__":
    main(sys.argv[1:])
