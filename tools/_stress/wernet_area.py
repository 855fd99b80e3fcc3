"""WERNet: learning rates, seeds, batches, encoders that explode, images that say nothing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np

from _stress.row import Progress, Row, Size, faults_of_refusing, relative_error, worst_of
from _stress.wernet_paper import paper_rows
from _stress.wernet_scene import GAIN_SPREAD, Run, Scene, filled, run, scene, trained_with

FACTORS = (0.01, 0.1, 1.0, 10.0, 100.0)
EXPLODING = (30.0, 1e3, 1e10, 1e30, np.inf, np.nan)
ROUNDING = 1e-6
"""By which a volume may seem worse than another that is the same."""


def rows(size: Size, progress: Progress) -> Iterator[Row]:
    """Yield the rows of the area as they are measured."""
    seen = scene()
    classic = seen.classic()
    steps = (_seeds, _trained, _exploding, _empty, _scaled, _little, _refused)
    for done, step in enumerate(steps):
        progress(done, len(steps), step.__name__.strip("_"))
        yield from step(seen, classic, size)
    yield from paper_rows(seen, size)


def over_classic(runs: Iterable[Run], seen: Scene, classic: np.ndarray) -> tuple[float, str]:
    """Return the worst error over the classic solve's, and where; infinite for a faulty end."""
    base = seen.error(classic)
    return worst_of(
        (
            one.name,
            np.inf if one.fault or one.found is None else seen.error(one.found.volume) / base,
        )
        for one in runs
    )


def _solve(seen: Scene, **options: object) -> partial:
    from tomo.wernet.default import wernet

    return partial(wernet, seen.projector, seen.measured, **options)


def _seeds(seen: Scene, classic: np.ndarray, size: Size) -> Iterator[Row]:
    count = 2 if size.quick else 8
    rounds = {"iterations": 2} if size.quick else {}
    runs = [run(f"seed {seed}", _solve(seen, seed=seed, **rounds)) for seed in range(count)]
    worst, where = over_classic(runs, seen, classic)
    volumes = [one.found.volume for one in runs if one.found is not None]
    errors = [seen.error(volume) for volume in volumes]
    spread = f"spread of the error over seeds {np.std(errors) / np.mean(errors):.2g} of it"
    over = f"{count} seeds"
    yield Row("wernet: seeds", over, worst, 1 + ROUNDING, "of the classic's error",
              note=f"{where}; {spread}")  # fmt: skip
    brightness = max(abs(volume.sum() / classic.sum() - 1) for volume in volumes)
    yield Row("wernet: total light, which chord lengths give", over, brightness, GAIN_SPREAD,
              "relative difference", note="the bound is the spread of the gains")  # fmt: skip


def _trained(seen: Scene, classic: np.ndarray, size: Size) -> Iterator[Row]:
    """Train at other rates and with other batches; a start given, there is no first guess."""
    from tomo.wernet.default import fixed_voxels

    pixels = len(seen.measured)
    factors, batches = (
        (FACTORS[::4], (100, pixels)) if size.quick else (FACTORS, (1, 10, 300, pixels))
    )
    rounds = {"iterations": 2} if size.quick else {}
    runs, gradients, wrong = [], 0, 0
    settings = [{"rate": factor * fixed_voxels.LEARNING_RATE} for factor in factors]
    for setting in (*settings, *({"rays": count} for count in batches)):
        name = ", ".join(f"{key} {value:g}" for key, value in setting.items())
        with trained_with(**setting) as counts:
            runs.append(run(name, _solve(seen, start=classic, **rounds)))
        gradients += counts["gradients"]
        wrong += counts["not_finite"]
    worst, where = over_classic(runs, seen, classic)
    yield Row("wernet: learning rates and batches",
              f"rates x {factors[0]:g} to {factors[-1]:g}, "
              f"{batches[0]} to {batches[-1]} rays a step",
              worst, 1 + ROUNDING, "of the classic's error", note=where)  # fmt: skip
    yield Row("wernet: gradients that are not finite where a step is taken",
              f"{gradients} gradients of those runs", wrong, 0, "faults")  # fmt: skip


def _exploding(seen: Scene, classic: np.ndarray, size: Size) -> Iterator[Row]:
    from tomo.wernet.default import CorrectionEncoder

    runs = []
    values = EXPLODING[2::3] if size.quick else EXPLODING
    for value in values:
        for frozen in (True,) if size.quick else (True, False):
            encoder = filled(CorrectionEncoder(), value)
            solve = _solve(seen, encoder=encoder, freeze_encoder=frozen, iterations=2)
            runs.append(run(f"weights {value:g}{', frozen' * frozen}", solve))
    yield _row_of_fallback("wernet: encoders that explode",
                           f"all weights {', '.join(f'{value:g}' for value in values)}",
                           runs, classic)  # fmt: skip


def _empty(seen: Scene, classic: np.ndarray, size: Size) -> Iterator[Row]:
    """Keep the pixels that see no voxel: dark as they are, and lit by what no voxel explains."""
    kept = scene(empty_rays=True)
    empty = kept.projector.row_sums == 0
    brightest = kept.measured.max()
    runs = []
    for what, light in (("dark", 0.0), ("lit", 0.1 * brightest)):
        measured = np.where(empty, light, kept.measured).astype(np.float32)
        lit = Scene(kept.projector, measured, kept.truth)
        runs.append(run(f"empty rays {what}", _solve(lit, iterations=2)))
    worst, where = over_classic(runs, seen, classic)
    yield Row("wernet: rays that cross no voxel", f"{empty.mean():.0%} of the rays, dark and lit",
              worst, 1 + ROUNDING, "of the classic's error without them",
              note=where)  # fmt: skip


def _row_of_fallback(stress: str, over: str, runs: list[Run], classic: np.ndarray) -> Row:
    """Return a row of runs that have to fall back to the classic solve, and to say so."""
    figures = []
    for one in runs:
        said = not one.fault and "the classic solve stays" in one.word
        figure = relative_error(one.found.volume, classic) if said else np.inf
        figures.append((f"{one.name}: {one.fault or one.word}", figure))
    worst, where = worst_of(figures)
    return Row(stress, over, worst, 0.0, "relative difference from the classic",
               note=where.partition(";")[0])  # fmt: skip


def _scaled(seen: Scene, classic: np.ndarray, size: Size) -> Iterator[Row]:
    plain = run("as it is", _solve(seen, iterations=2)).found.volume
    powers = (2.0**20,) if size.quick else (2.0**-40, 2.0**-20, 2.0**20, 2.0**40)
    figures, runs = [], []
    for factor in powers:
        found = run(f"x {factor:g}", _solve(_brighter(seen, factor), iterations=2)).found
        same = np.inf if found is None else relative_error(found.volume / factor, plain)
        figures.append((f"x {factor:g}", same))
    worst, where = worst_of(figures)
    yield Row("wernet: intensities by powers of two",
              ", ".join(f"x 2^{np.log2(power):.0f}" for power in powers),
              worst, 1e-5, "relative difference", note=where)  # fmt: skip
    for factor in (1e6,) if size.quick else (1e-30, 1e-6, 1e6, 1e30):
        brighter = _brighter(seen, factor)
        one = run(f"intensities x {factor:g}", _solve(brighter, iterations=2))
        runs.append(_in_plain_unit(one, factor))
    for factor in (1e-6,) if size.quick else (1e-6, 1e6):
        longer = scene(edge=0.5 * factor)
        one = run(f"lengths x {factor:g}", _solve(longer, iterations=2))
        runs.append(_in_plain_unit(one, longer.truth.max() / seen.truth.max()))
    worst, where = over_classic(runs, seen, classic)
    yield Row(
        "wernet: intensities and lengths by other factors",
        "x 1e-6 to 1e6" if size.quick else "intensities x 1e-30 to 1e30, lengths x 1e-6 to 1e6",
        worst,
        1 + ROUNDING,
        "of the classic's error",
        note=f"{where}; whether a trend is taken up may turn on rounding, so no bit is promised",
    )


def _brighter(seen: Scene, factor: float) -> Scene:
    scaled = (seen.measured.astype(np.float64) * factor).astype(np.float32)
    return Scene(seen.projector, scaled, seen.truth)


def _in_plain_unit(one: Run, factor: float) -> Run:
    from dataclasses import replace

    if one.found is None:
        return one
    volume = (one.found.volume.astype(np.float64) / factor).astype(np.float32)
    return replace(one, found=replace(one.found, volume=volume))


def _little(_: Scene, __: np.ndarray, size: Size) -> Iterator[Row]:
    """Give images that say nothing, or too few of them."""
    for views, over in ((1, "1 view"), (2, "2 views"), (0, "all-zero images")):
        if size.quick and views == 2:
            continue
        few = scene(views or 6)
        few = few if views else _brighter(few, 0.0)
        yield _row_of_fallback("wernet: little to learn from", over,
                               [run(over, _solve(few))], few.classic())  # fmt: skip


def _refused(seen: Scene, _: np.ndarray, __: Size) -> Iterator[Row]:
    calls = []
    for value in (np.nan, np.inf, -np.inf):
        measured = seen.measured.copy()
        measured[7] = value
        calls.append((f"{value}", _solve(Scene(seen.projector, measured, seen.truth))))
    faults = faults_of_refusing(calls)
    yield Row.of_faults("wernet: a pixel that is no number", "NaN, +inf, -inf", faults)
