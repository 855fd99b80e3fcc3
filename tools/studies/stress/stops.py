"""Noise: what it costs the default; and runs whose error falls, turns and rises again."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from studies.common.scans import reconstructed
from studies.stress.row import Chart, Row, worst_of
from studies.stress.scene import Scene, scene, solved
from tomo import solvers
from tomo.metrics import nrmse
from tomo.selection import choose_by_left_out_pixels, solve_as_chosen
from tomo.solvers.solution import Callback

NOISE = 0.1
NOISES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
LONGEST = 400
QUICK = 150
LONGEST_CHOSEN = 100
CASES = ((0.02, 4), (0.02, 9), (0.1, 4), (0.1, 9), (0.1, 33))
"""Noise and number of views at which stops are chosen."""


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
    worst, where = worst_of((f"{line['noise']:.0%}", line["relative_error"]) for line in lines)
    return Row(
        "noise: error of the default method",
        f"{noises[0]:.0%} to {noises[-1]:.0%} of the brightest pixel, 9 views",
        worst,
        1.0,
        "times that of an empty volume",
        note=where,
        lines={"noise": lines},
    )


def _methods(longest: int) -> Row:
    """Run every classic method far beyond its best."""
    seen = scene(NOISE)
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
    title = f"Error of the volume, {NOISE:.0%} noise, 9 views"
    return Row(
        "semi-convergence: the default number of iterations of a method",
        f"{NOISE:.0%} noise, 9 views, up to {longest} iterations",
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
