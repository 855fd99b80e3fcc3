"""The best that today's named methods can do: a frozen list, each stopped by the truth.

The list does not change when the default does: what is best is stored with the scene.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import write_json
from studies.benchmark.convergence import Candidate, converged, in_linear_basis
from studies.common.scans import Problem, problem
from studies.scenes.scene import KnownScene
from tomo.operators import LINEAR, VOXEL
from tomo.solvers.curvature import FIRST

VERSION = 1  # the list's version; another one tries all scenes anew

PLAIN: Mapping[str, int] = {
    "art": 30,
    "cgls": 60,
    "mart": 30,
    "mlem": 150,
    "nnls": 60,
    "sart": 40,
    "sirt": 150,
    "smart": 150,
}
"""Methods without a strength, and the most iterations of each."""

BY_PIXEL = ("art", "mart")
"""Methods that go through the rows of a stored matrix, which is in the voxel basis."""

STRENGTHS = (1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3)
"""Steps of about three, over all that noise asks for."""

STARTS: Mapping[str, float] = {"curvature": 1e-3, "tikhonov": 1e-3, "tv": 1e-4}
"""Where the way along the strengths begins; it goes on while the error falls."""

PASSES = 60


@dataclass(frozen=True)
class Best:
    """The best of the list for one scene."""

    # method, strength and basis; ``carved`` where voxels that dark pixels prove empty were left
    # out
    name: str
    # nrmse, cosine_distance: smallest over the iterations of that method
    nrmse: float
    cosine_distance: float
    by_method: Mapping[str, float]  # the smallest NRMSE of each method and basis


def best_of(scene: KnownScene, cache: Path | None = None) -> Best:
    """Return the best of the list, from the cache where it is there.

    All methods go through all pixels and voxels; the best of either basis also without the voxels
    that dark pixels prove empty. Pixels count alike.
    """
    path = None if cache is None else cache / f"oracle-{VERSION}-{scene.recipe.key}.json"
    if path is not None and path.is_file():
        return Best(**json.loads(path.read_text("utf-8")))
    images, found = scene.scan.images(), _Found(scene.truth)
    ready = problem(scene.rig, scene.grid, images, skip=False)
    for basis, one in ((VOXEL, ready), (LINEAR, in_linear_basis(ready))):
        _try_all(found, one, basis)
    ready = problem(scene.rig, scene.grid, images, skip=True)
    for basis, one in ((VOXEL, ready), (LINEAR, in_linear_basis(ready))):
        found.run(one, found.best(basis), carved=True)
    best = found.result()
    if path is not None:
        write_json(path, asdict(best), indent=1)
    return best


def _try_all(found: _Found, ready: Problem, basis: str) -> None:
    for method in PLAIN:
        if basis == VOXEL or method not in BY_PIXEL:
            found.run(ready, Candidate(method, basis=basis))
    for method, first in STARTS.items():
        start = STRENGTHS.index(first)
        errors = {start: found.run(ready, _with(method, first, basis))}
        for step in (1, -1):
            at = start
            while 0 <= at + step < len(STRENGTHS):
                errors[at + step] = found.run(ready, _with(method, STRENGTHS[at + step], basis))
                if errors[at + step] > errors[at]:
                    break
                at += step


def _with(method: str, strength: float, basis: str) -> Candidate:
    return Candidate(method, settings={"strength": strength}, basis=basis)


class _Found:
    """What the candidates came to."""

    def __init__(self, truth: NDArray[np.float32]) -> None:
        self.truth = truth
        self.errors: dict[str, tuple[float, float, Candidate]] = {}

    def run(self, ready: Problem, one: Candidate, *, carved: bool = False) -> float:
        """Return the smallest NRMSE of a candidate over its iterations."""
        how = {"passes": PLAIN.get(one.method, PASSES), "by_nrmse": True}
        least = FIRST if one.method == "curvature" else 0
        went = converged(ready, self.truth, one.method, one.settings, least_passes=least, **how)
        name = f"{one.name}, carved" if carved else one.name
        least = int(np.argmin(went.nrmses))
        self.errors[name] = went.nrmses[least], went.cosine_distances[least], one
        return went.nrmses[least]

    def best(self, basis: str) -> Candidate:
        """Return the best candidate so far of a basis."""
        return min((e for e in self.errors.values() if e[2].basis == basis), key=lambda e: e[0])[2]

    def result(self) -> Best:
        """Return the best of all."""
        name = min(self.errors, key=lambda name: self.errors[name][0])
        by_method: dict[str, float] = {}
        for error, _, one in self.errors.values():
            kind = f"{one.method}, {one.basis}"
            by_method[kind] = min(error, by_method.get(kind, np.inf))
        return Best(name, *self.errors[name][:2], by_method)
