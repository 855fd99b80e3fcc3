"""Calibration error: what wrong cameras cost each method, and whether the report says so."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from scipy.ndimage import shift

from studies.common.scans import reconstructed
from studies.common.study import Request
from studies.stress import calibration_scene as scenes
from studies.stress.calibration_scene import FOOTPRINT, GRID, KINDS, VIEWS, seen_wrongly
from studies.stress.row import Chart, Row, charts
from tomo import Scan, solvers
from tomo.pipeline import Options, reconstruct
from tomo.simulation.simulate import SimulatedImages as Flame

PLOTS = {"calibration": charts}

METHODS = ("auto", *solvers.METHODS)
CHARTED = ("auto", "cgls", "sirt", "mlem", "tv")
QUICK_METHODS = ("auto",)
PIXELS = (0.25, 0.5, 1.0, 2.0, 3.0)
JUDGED = (1.0, 3.0)
NOISE = 0.1
SEEDS = 8
APART = 2.0
"""Two views that are each off by some pixels are off by up to twice as many from each other."""

FROM = 1.0  # pixels from which on the report has to say so

SAYS_SO = ("pose", "magnification")
"""Effects of findings that say that cameras and images disagree."""


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    quick = request.size != "full"
    clean, noisy = _pair(request.seed)
    methods = QUICK_METHODS if quick else METHODS
    pixels = JUDGED if quick else PIXELS
    least = {method: _error(clean, "pose", 0.0, method) for method in methods}
    for kind in request.each(KINDS, str):
        yield from _growth(clean, kind, least, pixels)
    for kind in request.each(KINDS, "{}: warnings".format):
        for name, flame in (("clean", clean), (f"{NOISE:.0%} noise", noisy)):
            yield _warned_from(flame, kind, name, (0.5, 1.0) if quick else PIXELS)
    more = () if quick else range(request.seed + 1, request.seed + SEEDS)
    yield _false_alarms([(clean, noisy), *(_pair(seed) for seed in more)])
    yield _single(clean, noisy, 6 if quick else 1)


def _pair(seed: int) -> tuple[Flame, Flame]:
    """Return a flame without and with noise, simulated once."""
    made = scenes.simulated(seed)
    return made, scenes.noisier(made, NOISE, seed)


def _error(flame: Flame, kind: str, pixels: float, method: str) -> float:
    found = reconstructed(seen_wrongly(flame, kind, pixels), method=method, uncertainty=0)
    return found.solution.quality["nrmse"]


@cache
def moved_truth(flame: Flame, pixels: float) -> float:
    """Return the error of the truth where it is moved by so many pixels: r.m.s. over the axes."""
    truth = flame.truth.astype(np.float64)
    voxels = pixels * FOOTPRINT / GRID.spacing[0]
    errors = [np.linalg.norm(shift(truth, voxels * axis, order=1) - truth) for axis in np.eye(3)]
    return float(np.sqrt(np.mean(np.square(errors))) / np.linalg.norm(truth))


def _growth(
    flame: Flame, kind: str, least: dict[str, float], pixels: tuple[float, ...]
) -> Iterator[Row]:
    errors = {
        method: [
            (px, _error(flame, kind, px, method))
            for px in (pixels if method in CHARTED else JUDGED)
        ]
        for method in least
    }
    chart = Chart(
        f"{kind}: error by method", "pixels, r.m.s. along the flame", "NRMSE",
        {method: errors[method] for method in CHARTED if method in errors}
        | {"truth moved as far": [(px, moved_truth(flame, px)) for px in pixels]},
    )  # fmt: skip
    lines = [
        {"error": kind, "method": method, "pixels": px, "nrmse": error,
         "over_exact": error / least[method],
         "over_moved_truth": error / np.hypot(least[method], moved_truth(flame, px))}
        for method in errors
        for px, error in errors[method]
        if method in CHARTED
    ]  # fmt: skip
    for px in JUDGED:
        known = {method: dict(found)[px] for method, found in errors.items()}
        expected = {m: np.hypot(least[m], moved_truth(flame, px)) for m in known}
        worst = max(known, key=lambda method: known[method] / expected[method])
        growth = ", ".join(f"{m} {known[m] / least[m]:.1f}" for m in known)
        yield Row(
            f"{kind} off by {px:g} px: error against that of the truth moved as far",
            ", ".join(known), known[worst] / expected[worst], APART, "times",
            note=f"worst: {worst}; two views off by as much each may lie twice as far from each "
            f"other; growth over the clean error: {growth}",
            chart=chart if px == 1 else None,
            lines={"growth": lines} if px == 1 else {},
        )  # fmt: skip


def warnings_of(flame: Flame, kind: str, pixels: float, seed: int = 0) -> list[str]:
    """Return the cameras that are found beside the rig's where all are off by so many pixels."""
    return _found_off(seen_wrongly(flame, kind, pixels, seed))


def _found_off(scan: Scan) -> list[str]:
    found = reconstruct(scan, options=Options(method="mlem", iterations=1, uncertainty=0))
    return [str(one.camera) for one in found.findings if one.effect in SAYS_SO]


def _warned_from(flame: Flame, kind: str, name: str, pixels: tuple[float, ...]) -> Row:
    """Return from how many pixels on the report says so, and goes on saying so."""
    silent = [px for px in pixels if not warnings_of(flame, kind, px)]
    later = [px for px in pixels if px > max(silent, default=0.0)]
    return Row(
        f"{kind}: from where on the report says that cameras and images disagree",
        f"{pixels[0]:g} to {pixels[-1]:g} px, {name}", min(later, default=np.inf), FROM,
        "px, r.m.s. along the flame",
    )  # fmt: skip


def _false_alarms(pairs: Sequence[tuple[Flame, Flame]]) -> Row:
    alarms = [
        f"flame {number}, {name}"
        for number, pair in enumerate(pairs)
        for name, flame in zip(("clean", "noisy"), pair, strict=True)
        if warnings_of(flame, "pose", 0.0)
    ]
    over = f"{2 * len(pairs)} scenes, clean and with {NOISE:.0%} noise"
    return Row.of_faults("The right rig is doubted", over, alarms)


def _single(clean: Flame, noisy: Flame, every: int) -> Row:
    """Let one camera alone be off by two pixels."""
    unnamed = []
    for flame in (clean, noisy):
        for number in range(0, VIEWS, every):
            name = flame.rig.names[number]
            if name not in _found_off(scenes.one_off(flame, number, 2.0)):
                unnamed.append(name)
    return Row.of_faults(
        "One camera of 12 is off by 2 px and is not named", "clean and noisy", unnamed
    )
