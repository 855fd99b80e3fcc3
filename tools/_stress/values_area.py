"""Values: how bright, how dim, how wrong a pixel may be, from arrays and through files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from _stress.row import Progress, Row, Size, faults_of_refusing, relative_error, worst_of
from _stress.scaling_scene import Scaled
from _stress.values_pixels import pixel_rows
from _stress.values_scene import SMOOTHING, Scene, reconstructed, run, scene
from tomo.metrics import nrmse
from tomo.operators.operator import ProjectionOperator
from tomo.simulation.simulate import SimulatedScan

FACTORS = (1e-30, 1e-12, 3.7e-7, 3.7e6, 1e12, 1e30)
EXACT = 1e-5
Cases = Sequence[tuple[str, str, ProjectionOperator]]
SETTLED = 100
"""Iterations that gather one voxel's light."""
NEGATIVE_TOO = ("art", "cgls", "curvature", "nnls", "sart", "sirt", "tikhonov", "tv")


def rows(size: Size, progress: Progress) -> Iterator[Row]:
    """Yield the rows of the area."""
    seen = scene(noise=0.02)
    factors = FACTORS[::5] if size.quick else FACTORS
    cases = seen.cases()
    stored = [case for case in cases if case[2] is seen.stored] if size.quick else cases
    parts = (
        _scaled(seen, cases, factors),
        _scaled_files(seen, factors),
        _uneven(seen, stored),
        _degenerate(seen, stored),
        _single(seen, stored),
        pixel_rows(seen),
    )
    for number, part in enumerate(parts):
        progress(number, len(parts), "values")
        yield from part
    progress(len(parts), len(parts), "")


def _scaled(seen: Scene, cases: Cases, factors: Sequence[float]) -> Iterator[Row]:
    """Scale the images of every classic method, both forms of the matrix, at other intensities."""
    figures = []
    for name, method, projector in cases:
        plain = run(method, projector, seen.measured).volume
        for factor in factors:
            bright = (factor * seen.measured.astype(np.float64)).astype(np.float32)
            found = run(method, projector, bright).volume.astype(np.float64) / factor
            figures.append((f"{name}, {factor:g}", relative_error(found, plain)))
    worst, where = worst_of(figures)
    yield Row(
        "intensities, every classic method",
        _range(factors),
        worst,
        EXACT,
        "relative to scale 1",
        note=where,
    )


def _scaled_files(seen: Scene, factors: Sequence[float]) -> Iterator[Row]:
    """Scale the default method's images: through a scan and its files."""
    figures, plain = [], None
    for factor in (1.0, *factors):
        scaled = Scaled(seen.simulated, intensities=factor)
        found = scaled.unscaled(
            reconstructed(scaled.simulated, uncertainty=0).reconstruction.volume
        )
        plain = found if plain is None else plain
        figures.append((f"{factor:g}", relative_error(found, plain)))
    worst, where = worst_of(figures)
    yield Row(
        "intensities, default method through files",
        _range(factors),
        worst,
        EXACT,
        "relative to scale 1",
        note=where,
    )


def _uneven(seen: Scene, cases: Cases) -> Iterator[Row]:
    """See a volume whose lower half is 1e-12 of its upper one."""
    middle = seen.grid.shape[1] // 2
    upper = seen.truth.copy()
    upper[:, :middle] = 0
    both = upper + np.float32(1e-12) * (seen.truth - upper)
    figures = []
    for name, method, projector in cases:
        alone, uneven = (
            nrmse(run(method, projector, projector @ volume.ravel()).volume, volume)
            for volume in (upper, both)
        )
        figures.append((name, uneven / alone))
    worst, where = worst_of(figures)
    yield Row(
        "dynamic range in one volume, every classic method",
        "1 to 1e12",
        worst,
        1.05,
        "times the error of the bright half alone",
        note=f"{where}; what is free to move changes the path, not the end",
    )


def _degenerate(seen: Scene, cases: Cases) -> Iterator[Row]:
    """Show images without a flame: what comes out is finite, and zero where nothing is lit."""
    images = _without_flame(seen.measured)
    faults, lit = [], []
    for name, method, projector in cases:
        for what, pixel in images.items():
            volume = run(method, projector, pixel).volume
            if not (np.isfinite(volume).all() and volume.min() >= 0):
                faults.append(f"{name}, {what}")
            # CGLS is clipped only as it is reported: negative images have a shadow above zero.
            if what == "zero" or (what == "negative" and method != "cgls"):
                lit.append((f"{name}, {what}", float(np.abs(volume).max())))
        if method in NEGATIVE_TOO:
            free = run(method, projector, -seen.measured, nonnegative=False).volume
            mirrored = run(method, projector, seen.measured, nonnegative=False).volume
            if not np.array_equal(free, -mirrored):
                faults.append(f"{name}, mirrored")
    yield Row.of_faults(
        "images that show no flame, every classic method", ", ".join(images), faults
    )
    worst, where = worst_of(lit)
    yield Row(
        "zero and negative images: brightest voxel", "every classic method, CGLS at zero alone",
        worst, 0.0, "largest emission", note=where,
    )  # fmt: skip
    bright = np.full(len(seen.measured), 3e38)
    loud = [
        (name, method)
        for name, method, projector in cases
        if not _finite_or_refused(lambda m=method, p=projector: run(m, p, bright).volume)
    ]
    yield Row(
        "the brightest pixels of single precision: a finite volume or a refusal",
        "3e38",
        len(loud),
        0,
        "faults",
        note="; ".join(name for name, _ in loud),
    )
    yield _degenerate_files(seen.simulated)


def _single(seen: Scene, cases: Cases) -> Iterator[Row]:
    """See one bright voxel in an empty grid."""
    volume = np.zeros(seen.grid.shape, np.float32)
    place = tuple(n // 2 + 1 for n in seen.grid.shape)
    volume[place] = 1e6
    beside, height = [], []
    for name, method, projector in cases:
        plain = {"strength": 0.0} if method in SMOOTHING else {}
        found = run(method, projector, projector @ volume.ravel(), SETTLED, **plain).volume
        at = np.unravel_index(np.argmax(found), found.shape)
        beside.append((name, float(np.abs(np.subtract(at, place)).max())))
        height.append((name, abs(float(found[place]) / 1e6 - 1)))
    for what, figures, bound, unit in (
        ("its place", beside, 0.0, "voxels beside"),
        ("its emission", height, 0.03, "relative error"),
    ):
        worst, where = worst_of(figures)
        yield Row(f"one bright voxel: {what}", "1e6 among zeros", worst, bound, unit, note=where)


def _degenerate_files(simulated: SimulatedScan) -> Row:
    """Give the default method images without a flame."""
    changed = {name: _without_flame(image) for name, image in simulated.images.items()}
    kinds = tuple(next(iter(changed.values())))
    faults = []
    for kind in kinds:
        images = {name: of[kind].astype(np.float32) for name, of in changed.items()}
        scan = replace(simulated, images=MappingProxyType(images))
        if not _finite_or_refused(lambda s=scan: reconstructed(s).reconstruction.volume):
            faults.append(kind)
    return Row.of_faults(
        "images that show no flame, default method through files: a finite volume, not negative, "
        "or a refusal",
        ", ".join(kinds),
        faults,
    )


def _without_flame(pixels: NDArray) -> Mapping[str, NDArray]:
    """Return what may stand where a flame was measured: arrays like ``pixels``."""
    odd = np.arange(pixels.size).reshape(pixels.shape) % 2
    return {
        "zero": np.zeros(pixels.shape),
        "constant": np.full(pixels.shape, 3.0),
        "negative": -1 - pixels,
        "partly negative": pixels - 0.2 * pixels.max(),
        "alternating 1e12 and 1": np.where(odd, 1e12, 1.0),
        "alternating 1e30 and -1e30": np.where(odd, 1e30, -1e30),
        "white noise": np.random.default_rng(0).standard_normal(pixels.shape),
    }


def _finite_or_refused(solve: Callable[[], NDArray]) -> bool:
    """Return whether a volume is finite and not negative, or is refused in one line."""

    def infinite() -> None:
        volume = solve()
        if np.isfinite(volume).all() and volume.min() >= 0:
            raise ValueError("finite")

    return not faults_of_refusing([("", infinite)])


def _range(factors: Sequence[float]) -> str:
    return f"{min(factors):g} to {max(factors):g}"
