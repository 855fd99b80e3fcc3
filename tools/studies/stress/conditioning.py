"""Too few views, cameras at one place, voxels unseen, noise, and too many iterations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from studies.common.scans import reconstructed
from studies.common.study import Request, Tables
from studies.stress.row import COLUMNS, Row, charts, measured, worst_of
from studies.stress.scene import (
    SHAPE,
    SMOOTHING,
    SPACING,
    Scene,
    ring,
    scene_of,
    solved,
)
from studies.stress.stops import stop_rows
from tomo import VoxelGrid, solvers
from tomo.metrics import nrmse
from tomo.pipeline import Reconstruction

__all__ = ["COLUMNS", "PLOTS", "run"]

PLOTS = {"conditioning": charts}

VIEWS = (1, 2, 3, 5, 9, 17, 33)
FAN = 30.0  # degrees
NOISE = 0.02


def run(request: Request) -> Tables:
    """Measure the rows of this part."""
    return measured(_rows(request))


def _rows(request: Request) -> Iterator[Row]:
    quick = request.size != "full"
    for number, part in enumerate((rig_rows, stop_rows)):
        request.progress(number, 2, ("rigs", "noise and stops")[number])
        yield from part(quick)
    request.progress(2, 2, "")


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
    return Row.of_faults(
        "rigs that say too little: finite volumes, not negative, every classic method",
        ", ".join(scenes),
        faults,
    )


def _better_than_nothing(
    scenes: Mapping[str, Scene], outcomes: Mapping[str, Reconstruction]
) -> Row:
    worst, where = worst_of(
        (name, nrmse(_volume(outcomes[name]), seen.truth)) for name, seen in scenes.items()
    )
    return Row(
        "rigs that say too little: error of the default method",
        ", ".join(scenes),
        worst,
        1.0,
        "times that of an empty volume",
        note=where,
    )


def _more_views(
    views: tuple[int, ...], scenes: Mapping[str, Scene], outcomes: Mapping[str, Reconstruction]
) -> Row:
    errors = [nrmse(_volume(outcomes[f"{n} views"]), scenes[f"{n} views"].truth) for n in views]
    worst, where = worst_of(
        (f"from {views[n]} to {views[n + 1]}", errors[n + 1] / errors[n])
        for n in range(len(views) - 1)
    )
    lines = [{"views": n, "relative_error": error} for n, error in zip(views, errors, strict=True)]
    return Row(
        "more views, smaller error, default method",
        f"{views[0]} to {views[-1]} views",
        worst,
        1.05,
        "times the error with fewer",
        note=where,
        lines={"views": lines},
    )


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
    worst, where = worst_of(lit)
    yield Row(
        "voxels that no ray crosses stay zero",
        f"{dark.mean():.0%} of the volume",
        worst,
        0.0,
        "largest emission",
        note=where,
    )
    unseen = outcome.unseen.sum() / outcome.unseen.size
    quiet = not any("seen by no camera" in warning for warning in outcome.warnings)
    yield Row(
        "voxels that no ray crosses are reported",
        f"{unseen:.0%} of the volume",
        float(quiet),
        0,
        "faults",
    )


def _volume(outcome: Reconstruction) -> NDArray[np.float32]:
    return outcome.solution.volume
