"""One row: a training of the network or a run of ART, and what came of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from rigs.files import atomic_path
from rigs.files.text import write_text
from studies.paper.cases import Case, case
from studies.paper.rows import Row
from tomo import LinearSystem, metrics, solvers
from tomo.wernet import (
    PaperSettings,
    TrainingDivergedError,
    load_settings,
    save_encoder,
    wernet_paper,
)

_RELAXATIONS = (0.01, 0.03, 0.1, 0.3)
_PLAIN_RELAXATION, _PLAIN_SWEEPS = 1.0, 10
_MOST_SWEEPS, _PATIENCE = 40, 5

Say = Callable[[int, int, str], None]


def measured_row(row: Row, out: Path, say: Say) -> dict[str, Any]:
    """Do a row; write its settings, volume and encoder to ``out``, and return its figures.

    An encoder that it starts from is there already. ``curve`` is a list of (epoch or sweep, cosine
    distance, relative residual).
    """
    seen = case(row.flame, row.layout, row.grid, row.noise)
    course: list[tuple[int, float, float]] = []
    best: tuple[float, NDArray[np.float32]] = np.inf, np.zeros_like(seen.truth)
    own = row.art == "best"

    def judge(index: int, volume: NDArray[np.float32], residual: float) -> bool:
        nonlocal best
        found = _system(row, seen).projector.active.expand(volume).reshape(seen.truth.shape)
        distance = metrics.cosine_distance(found, seen.truth)
        course.append((index, distance, residual))
        if not own or distance < best[0]:
            best = distance, found
        say(index, row.epochs, f"{row.name}: {distance:.3g}")
        return own and _is_past_best(course)

    started, worked = time.perf_counter(), time.process_time()
    how = _by_art(row, seen, course, judge) if row.art else _by_network(row, seen, out, judge)
    seconds, work = time.perf_counter() - started, time.process_time() - worked
    volume = best[1]
    with atomic_path(out / "volumes" / f"{row.name}.npy") as place, place.open("wb") as file:
        np.save(file, volume)
    distances = [distance for _, distance, _ in course]
    last = metrics.cosine_distance(volume, seen.truth) if course else 1.0
    return {
        "flame": row.flame,
        "layout": row.layout,
        "noise": row.noise,
        "seed": row.seed,
        "encoder_of": row.encoder_of or None,
        "frozen": row.frozen,
        "epochs": row.epochs,
        "art": row.art or None,
        **seen.described(),
        **how,
        "cosine_distance": last,
        "best_cosine_distance": min(distances, default=1.0),
        "best_epoch": int(np.argmin(distances)) + 1 if distances else None,
        "nrmse": metrics.nrmse(volume, seen.truth),
        "seconds": seconds,
        "core_seconds_per_epoch": work / max(len(course), 1),
        "curve": course,
    }


def written_settings(row: Row, out: Path) -> PaperSettings:
    """Write the settings of a row to a file that ``--wernet-settings`` takes; read them back."""
    path = out / "settings" / f"{row.name}.yaml"
    write_text(path, yaml.safe_dump(asdict(row.settings), sort_keys=False))
    return load_settings(path, PaperSettings)


def _by_network(row: Row, seen: Case, out: Path, judge: Callable[..., bool]) -> dict[str, Any]:
    settings = written_settings(row, out)
    try:
        found = wernet_paper(
            seen.system.projector,
            seen.measured,
            iterations=row.epochs,
            callback=judge,
            settings=settings,
            encoder=out / "encoders" / f"{row.encoder_of}.pt" if row.encoder_of else None,
            freeze_encoder=row.frozen,
            seed=row.seed,
        )
        end = found.stop_reason
        if found.encoder is not None:
            save_encoder(found.encoder, out / "encoders" / f"{row.name}.pt")
    except TrainingDivergedError as error:
        end = str(error)
    steps = -(-seen.described()["rays"] // settings.rays_per_step)
    return {"end": end, **asdict(settings), "steps_per_epoch": steps}


def _by_art(
    row: Row, seen: Case, course: list[tuple[int, float, float]], judge: Callable[..., bool]
) -> dict[str, Any]:
    """Run Kaczmarz sweeps with non-negativity on all pixels and voxels."""
    projector, measured = seen.whole.projector, seen.whole.flatten(seen.images)
    if row.art == "plain":
        sweeps = min(_PLAIN_SWEEPS, row.epochs)
        solvers.art(
            projector, measured, iterations=sweeps, relaxation=_PLAIN_RELAXATION, callback=judge
        )
        return {"relaxation": _PLAIN_RELAXATION, "sweeps": sweeps}
    reached = []
    for relaxation in _RELAXATIONS:
        course.clear()
        solvers.art(
            projector, measured, iterations=min(_MOST_SWEEPS, row.epochs), relaxation=relaxation,
            callback=judge,
        )  # fmt: skip
        reached.append((min((d, n) for n, d, _ in course), relaxation, list(course)))
    (_, sweeps), relaxation, found = min(reached)
    course[:] = found
    return {"relaxation": relaxation, "sweeps": sweeps}


def _system(row: Row, seen: Case) -> LinearSystem:
    return seen.whole if row.art else seen.system


def _is_past_best(course: list[tuple[int, float, float]]) -> bool:
    """Return whether the last few sweeps were no nearer to the truth than one before them."""
    distances = [distance for _, distance, _ in course]
    return len(distances) - 1 - int(np.argmin(distances)) >= _PATIENCE
