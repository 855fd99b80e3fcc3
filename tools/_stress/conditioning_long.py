"""Far more iterations than anyone asks for: nothing may drift, grow or cease to be a number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from _stress.row import Row, worst_of
from _stress.values_scene import Scene, ring, run, scene_of
from tomo import VoxelGrid, solvers
from tomo._compute.reductions import norm
from tomo.solvers import Solution

ITERATIONS = 10_000
QUICK = 400
FREE = ("cgls", "nnls")
"""Methods that without bounds tend to the least squares of least norm."""


@cache
def small_scene() -> Scene:
    """Return a scene so small that ten thousand iterations take seconds."""
    rig = ring(5, image_size=(10, 18), footprint=0.9)
    return scene_of(rig, 0.05, VoxelGrid((6, 12, 6), 1.0))


def long_rows(quick: bool) -> Iterator[Row]:
    """Yield the rows of long runs."""
    seen = small_scene()
    count = QUICK if quick else ITERATIONS
    over = f"{count} iterations, {', '.join(_images(seen, quick))}"
    faults, grown, apart, lost = [], [], [], []
    for what, measured in _images(seen, quick).items():
        for method in solvers.METHODS:
            name = f"{method}, {what}"
            found, finite = _watched(method, seen, measured, count)
            if not (finite and found.volume.min() >= 0):
                faults.append(name)
            grown.append((name, _late_growth(found)))
            if method == "cgls":  # its record is that of the volume before it is clipped
                continue
            apart.append((name, abs(_residual(seen, measured, found) - found.relative_residual)))
            if method == "mlem":
                lost.append((name, _lost_light(seen, measured, found)))
    yield Row.of_faults(
        "long runs, every classic method: finite volumes, not negative", over, faults
    )
    worst, where = worst_of(grown)
    yield Row(
        "long runs, every classic method: residual at the end", over, worst, 1.001,
        "times the lowest of the second half", note=where,
    )  # fmt: skip
    free = [
        (f"{method}, {what}", method, measured, _free(method, seen, measured, count))
        for what, measured in _images(seen, quick).items()
        for method in FREE
    ]
    apart += [
        (f"{name}, free", abs(_residual(seen, pixels, found) - found.relative_residual))
        for name, _, pixels, found in free
    ]
    worst, where = worst_of(apart)
    yield Row(
        "long runs: residual on record against that of the volume in double precision", over,
        worst, 2e-6, "of the images", note=where,
    )  # fmt: skip
    worst, where = worst_of(lost)
    yield Row(
        "long runs: MLEM keeps the light of the images", over, worst, 1e-5, "of it", note=where
    )
    matrix = seen.stored.to_scipy().toarray().astype(np.float64)
    inverse = np.linalg.pinv(matrix)
    worst, where = worst_of(
        (name, norm(found.volume) / norm(inverse @ measured)) for name, _, measured, found in free
    )
    yield Row(
        "long runs without bounds: size of the volume", over, worst, 1.001,
        "times that of the least squares of least norm in double precision", note=where,
    )  # fmt: skip


def _images(seen: Scene, quick: bool) -> Mapping[str, NDArray[np.float32]]:
    middle = np.arange(len(seen.measured)) == len(seen.measured) // 2
    top = seen.measured.max()
    noise = np.random.default_rng(0).standard_normal(len(seen.measured))
    images = {"noise alone": noise, "a wild pixel": np.where(middle, 1e5 * top, seen.measured)}
    if not quick:
        images["a noisy flame"] = seen.measured
    return {name: pixels.astype(np.float32) for name, pixels in images.items()}


def _watched(method: str, seen: Scene, measured: NDArray, count: int) -> tuple[Solution, bool]:
    """Return a long run, and whether each of its volumes was finite."""
    finite = []

    def watch(index: int, volume: NDArray[np.float32], residual: float) -> bool:
        finite.append(bool(np.isfinite(volume).all()))
        return False

    return run(method, seen.stored, measured, count, callback=watch), all(finite)


def _free(method: str, seen: Scene, measured: NDArray, count: int) -> Solution:
    return run(method, seen.stored, measured, count, nonnegative=False)


def _late_growth(found: Solution) -> float:
    residuals = [entry.relative_residual for entry in found.history]
    return residuals[-1] / min(residuals[len(residuals) // 2 :])


def _residual(seen: Scene, measured: NDArray, found: Solution) -> float:
    projected = seen.stored @ found.volume.ravel().astype(np.float64)
    return norm(measured - projected) / norm(measured)


def _lost_light(seen: Scene, measured: NDArray, found: Solution) -> float:
    """Return how far the projection's total is from the images', negative pixels cut."""
    total = float((seen.stored @ found.volume.ravel().astype(np.float64)).sum())
    return abs(total / np.maximum(measured, 0).sum(dtype=np.float64) - 1)
