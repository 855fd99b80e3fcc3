"""Too few views, cameras at one place, voxels unseen, noise, and too many iterations.

Noise: what it costs the default, and runs whose error falls, turns and rises again.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from studies.common.scans import reconstructed
from studies.common.study import Request
from studies.stress.row import Chart, Row, charts, worst_of
from studies.stress.scene import SHAPE, SMOOTHING, SPACING, Scene, ring, scene, scene_of, solved
from tomo import VoxelGrid, solvers
from tomo.metrics import nrmse
from tomo.pipeline import Reconstruction
from tomo.selection import choose_by_left_out_pixels, solve_as_chosen
from tomo.solvers.solution import Callback

PLOTS = {"conditioning": charts}

VIEWS = (1, 2, 3, 5, 9, 17, 33)
FAN = 30.0  # degrees
NOISE = 0.02

STOP_NOISE = 0.1
NOISES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
LONGEST = 400
QUICK = 150
LONGEST_CHOSEN = 100
CASES = ((0.02, 4), (0.02, 9), (0.1, 4), (0.1, 9), (0.1, 33))
"""Noise and number of views at which stops are chosen."""


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    parts = {"rigs": rig_rows, "noise and stops": stop_rows}
    for name in request.each(parts, str):
        yield from parts[name](request.size != "full")


def rig_rows(quick: bool) -> Iterator[Row]:
    """Yield the rows of rigs."""
    views = VIEWS[::2] if quick else VIEWS
    scenes = {f"{count} views": scene_of(ring(count), NOISE) for count in views}
    scenes |= {name: make() for name, make in _WEAK.items()}
    yield _finite(scenes)
    outcomes = {
        name: reconstructed(seen.simulated, uncertainty=0) for name, seen in scenes.items()
    }
    yield _better_than_nothing(scenes, outcomes)
    yield _more_views(views, scenes, outcomes)
    yield from _unseen(scenes, outcomes)


def fan(count: int = 9) -> Rig:
    """Return cameras all within a narrow angle."""
    return ring(count, step_degrees=FAN / (count - 1))


def narrow(count: int = 9) -> Rig:
    """Return cameras whose images show the middle of the volume alone."""
    return ring(count, image_size=(10, 16))


_WEAK = {
    f"a fan of {FAN:.0f} degrees": lambda: scene_of(fan(), NOISE),
    "all cameras at one place": lambda: scene_of(ring(9, step_degrees=0.0), NOISE),
    "more unknowns than rays": lambda: scene_of(
        ring(3), NOISE, VoxelGrid(tuple(2 * n for n in SHAPE), SPACING / 2)
    ),
    "partly unseen": lambda: scene_of(narrow(), NOISE),
}


def _finite(scenes: Mapping[str, Scene]) -> Row:
    """Run every classic method on every rig."""
    faults = []
    for name, seen in scenes.items():
        for method in solvers.METHODS:
            found = solved(method, seen.stored, seen.measured)
            if not (np.isfinite(found.volume).all() and found.volume.min() >= 0):
                faults.append(f"{method}, {name}")
    stress = "rigs that say too little: finite volumes, not negative, every classic method"
    return Row.of_faults(stress, ", ".join(scenes), faults)


def _better_than_nothing(
    scenes: Mapping[str, Scene], outcomes: Mapping[str, Reconstruction]
) -> Row:
    errors = [(name, nrmse(_volume(outcomes[name]), seen.truth)) for name, seen in scenes.items()]
    stress = "rigs that say too little: error of the default method"
    return Row.of_worst(stress, ", ".join(scenes), errors, 1.0, "times that of an empty volume")


def _more_views(
    views: tuple[int, ...], scenes: Mapping[str, Scene], outcomes: Mapping[str, Reconstruction]
) -> Row:
    errors = [nrmse(_volume(outcomes[f"{n} views"]), scenes[f"{n} views"].truth) for n in views]
    growth = [
        (f"from {views[n]} to {views[n + 1]}", errors[n + 1] / errors[n])
        for n in range(len(views) - 1)
    ]
    lines = [{"views": n, "relative_error": error} for n, error in zip(views, errors, strict=True)]
    stress, over = "more views, smaller error, default method", f"{views[0]} to {views[-1]} views"
    unit = "times the error with fewer"
    return Row.of_worst(stress, over, growth, 1.05, unit, lines={"views": lines})


def _unseen(scenes: Mapping[str, Scene], outcomes: Mapping[str, Reconstruction]) -> Iterator[Row]:
    """Look at the voxels that no ray crosses."""
    seen, outcome = scenes["partly unseen"], outcomes["partly unseen"]
    dark = seen.stored.column_sums == 0
    lit = []
    for method in solvers.METHODS:
        if method in SMOOTHING:  # those follow their neighbours
            continue
        volume = solved(method, seen.stored, seen.measured).volume.ravel()
        lit.append((method, float(np.abs(volume[dark]).max())))
    lit.append(("default", float(np.abs(outcome.volume[outcome.unseen]).max())))
    over = f"{dark.mean():.0%} of the volume"
    stress = "voxels that no ray crosses stay zero"
    yield Row.of_worst(stress, over, lit, 0.0, "largest emission")
    unseen = outcome.unseen.sum() / outcome.unseen.size
    quiet = not any("seen by no camera" in warning for warning in outcome.warnings)
    over = f"{unseen:.0%} of the volume"
    yield Row("voxels that no ray crosses are reported", over, float(quiet), 0, "faults")


def _volume(outcome: Reconstruction) -> NDArray[np.float32]:
    return outcome.solution.volume


def stop_rows(quick: bool) -> Iterator[Row]:
    """Yield the rows of noise, and of where runs stop."""
    yield noise_row(NOISES[::3] if quick else NOISES)
    yield _methods(QUICK if quick else LONGEST)
    yield _chosen(CASES[1::2] if quick else CASES)


def noise_row(noises: Sequence[float]) -> Row:
    """Reconstruct by default at growing noise."""
    lines = []
    for noise in noises:
        seen = scene(noise)
        found = reconstructed(seen.simulated, uncertainty=0)
        lines.append({"noise": noise, "relative_error": nrmse(found.volume, seen.truth)})
    errors = [(f"{line['noise']:.0%}", line["relative_error"]) for line in lines]
    over = f"{noises[0]:.0%} to {noises[-1]:.0%} of the brightest pixel, 9 views"
    stress, unit = "noise: error of the default method", "times that of an empty volume"
    return Row.of_worst(stress, over, errors, 1.0, unit, lines={"noise": lines})


def _methods(longest: int) -> Row:
    """Run every classic method far beyond its best."""
    seen = scene(STOP_NOISE)
    curves, said, figures = {}, [], []
    for method in solvers.METHODS:
        errors: list[float] = []
        solved(method, seen.stored, seen.measured, longest, callback=_recorder(seen, errors))
        default = inspect.signature(getattr(solvers, method)).parameters["iterations"].default
        best = int(np.argmin(errors))
        stopped = errors[min(default, len(errors) - 1)]
        curves[method] = [(index, error) for index, error in enumerate(errors) if index]
        said.append(f"{method} best at {best}, at {default} {stopped / errors[best]:.2f} times")
        figures.append((method, stopped / errors[best]))
    worst, where = worst_of(figures)
    title = f"Error of the volume, {STOP_NOISE:.0%} noise, 9 views"
    return Row(
        "semi-convergence: the default number of iterations of a method",
        f"{STOP_NOISE:.0%} noise, 9 views, up to {longest} iterations",
        worst,
        3.0,
        "times the lowest error of the run",
        note=f"{where}; no fixed number suits every noise: the default method's stop is the next "
        f"row's; {'; '.join(said)}",
        chart=Chart(title, "iterations", "relative error", curves),
    )


def _chosen(cases: Sequence[tuple[float, int]]) -> Row:
    """Let pixels left out choose the stop, and go on beyond it."""
    figures, curves = [], {}
    for noise, views in cases:
        seen = scene(noise, views)
        choice = choose_by_left_out_pixels(seen.stored, seen.measured)
        errors: list[float] = []
        further = replace(choice, iterations=LONGEST_CHOSEN)
        record = _recorder(seen, errors)
        solve_as_chosen(seen.stored, seen.measured, further, callback=record)
        best = int(np.argmin(errors))
        ratio = errors[min(choice.iterations, len(errors) - 1)] / min(errors)
        name = f"{noise:.0%} noise, {views} views"
        chosen = f"{name}: strength {choice.strength:g} stopped at {choice.iterations}"
        figures.append((f"{chosen}, best at {best}", ratio))
        curves[name] = [(index, error) for index, error in enumerate(errors) if index]
    worst, where = worst_of(figures)
    return Row(
        "semi-convergence: the stop that pixels left out choose",
        ", ".join(f"{noise:.0%} noise and {views} views" for noise, views in cases),
        worst,
        1.25,
        "times the lowest error of the run",
        note=f"{where}; all: " + "; ".join(f"{name}, {ratio:.2f}" for name, ratio in figures),
        chart=Chart("Error along the method chosen", "iterations", "relative error", curves),
    )


def _recorder(seen: Scene, errors: list[float]) -> Callback:
    """Return a callback that notes the error of every volume."""

    def record(index: int, volume: NDArray[np.float32], residual: float) -> bool:
        errors.append(nrmse(volume, seen.truth.ravel()))
        return False

    return record
