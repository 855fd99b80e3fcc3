"""Reconstructions of flames that are seen through optics, which the model knows or not.

Twelve views on a ring, turbulent flames, 36 x 48 x 36 voxels, images of 128 x 160 pixels with 1 %
noise of the brightest pixel, by a second forward model: dense sampling along rays that closed-form
optics bend, block, reflect or spread over a lens. NRMSE of the default method: `without` the
obstacle, `modelled`, and `ignored`; `ratio` is modelled over without and is to be at most `bound`;
`loss` is ignored over without. Noise has the size that it has without the obstacle.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from studies.common.scans import reconstructed, seconds_of
from studies.common.study import Request, Tables
from studies.optics.cases import CASES, base
from studies.optics.light import Flame, image
from studies.optics.sights import Sight
from tomo import Scan, VoxelGrid

NOISE = 0.01
SEEDS = 2
SMALL = 0.5  # by how much grid and images are smaller in a quick or tiny run
Row = dict[str, Any]


def run(request: Request) -> Tables:
    """Reconstruct every case with every flame; in a quick or tiny run every fifth."""
    scale, count, every = (1.0, SEEDS, 1) if request.size == "full" else (SMALL, 1, 5)
    cases = product(range(request.seed + 1, request.seed + 1 + count), list(CASES)[::every])
    rows: list[Row] = []
    for seed, name in request.each(cases, "{0[1]}, seed {0[0]}".format):
        rows += case_rows(name, seed, scale)
    return summaries(rows) | {"runs": rows}


def case_rows(name: str, seed: int, scale: float = 1.0) -> list[Row]:
    """Return a row for each way to reconstruct a case: without, modelled, ignored."""
    case, flame = CASES[name](base(scale)), _flame(seed, scale)
    direct = replace(case.ignoring, cameras=tuple(sight.camera for sight in case.without))
    clean = images_of(case.without, flame)
    sigma = NOISE * max(float(one.max()) for one in clean.values())
    seen = with_noise(images_of(case.sights, flame, case.extinction), sigma, seed)
    ways = {
        "without": _solved(direct, case.without, flame),
        "modelled": _quality(case.modelled, seen, flame, **case.options),
        "ignored": _quality(case.ignoring, seen, flame),
    }
    kind = {"case": case.name, "seed": seed, "bound": case.bound}
    return [kind | {"way": way} | quality for way, quality in ways.items()]


def images_of(
    sights: Sequence[Sight], flame: Flame, extinction: float = 0.0
) -> dict[str, NDArray[np.float64]]:
    """Return images without noise."""
    return {sight.camera.name: _light(sight, flame, extinction) for sight in sights}


def with_noise(
    images: Mapping[str, NDArray[np.float64]], sigma: float, seed: int
) -> dict[str, NDArray[np.float32]]:
    """Return images with white noise, the same for the same number of a view in all cases."""
    found = {}
    for view, (name, one) in enumerate(images.items()):
        noise = np.random.default_rng([seed, view]).normal(size=one.shape)
        found[name] = (one + sigma * noise).astype(np.float32)
    return found


def summaries(rows: Sequence[Row]) -> Tables:
    """Return means over flames, a row a case, of NRMSE and of the cosine distance."""
    cases, distances = [], []
    for name in dict.fromkeys(row["case"] for row in rows):
        own = [row for row in rows if row["case"] == name]
        errors, cosines = (
            {
                way: statistics.fmean(row[key] for row in own if row["way"] == way)
                for way in dict.fromkeys(row["way"] for row in own)
            }
            for key in ("nrmse", "cosine_distance")
        )
        ratio, bound = errors["modelled"] / errors["without"], own[0]["bound"]
        judged = {"ratio": ratio, "bound": bound, "holds": ratio <= bound}
        loss = errors["ignored"] / errors["without"]
        cases.append({"case": name} | errors | judged | {"loss": loss})
        distances.append({"case": name} | cosines)
    return {"nrmse": cases, "cosine_distance": distances}


@lru_cache(maxsize=1)
def _flame(seed: int, scale: float) -> Flame:
    volume = base(scale).volume
    return Flame(seed, VoxelGrid(volume.shape, volume.spacing, volume.center))


@lru_cache(maxsize=64)
def _light(sight: Sight, flame: Flame, extinction: float) -> NDArray[np.float64]:
    return image(sight, flame, extinction)


@lru_cache(maxsize=2)
def _solved(rig: Rig, sights: tuple[Sight, ...], flame: Flame) -> Row:
    """Return the quality with nothing in the way, which several cases share."""
    clean = images_of(sights, flame)
    sigma = NOISE * max(float(one.max()) for one in clean.values())
    return _quality(rig, with_noise(clean, sigma, flame.seed), flame)


def _quality(rig: Rig, images: Mapping[str, NDArray], flame: Flame, **options: Any) -> Row:
    scan = Scan.from_arrays(rig, images, flame.grid, truth=flame.means)
    outcome = reconstructed(scan, **options)
    quality = outcome.solution.quality
    return {
        "nrmse": quality["nrmse"],
        "cosine_distance": quality["cosine_distance"],
        "seconds": seconds_of(outcome),
        "warnings": list(outcome.warnings),
    }
