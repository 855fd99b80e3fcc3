"""The paper's experiments: each part trains what it needs and returns plain rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _paper.cases import FINER, NOISE, SHIFTED, Case, case
from _paper.sizes import PAPER_SAMPLES, Sizes
from _paper.training import Progress, Reading, Source, first_steps, section, trained
from tomo import LinearSystem, metrics, solvers

Rows = dict[str, list[dict[str, Any]]]
LAYOUTS = ("paper33_level", "paper33_pitch", "paper33_random", "paper33_level" + SHIFTED)
FINER_LAYOUT = "paper33_level" + FINER
FEW_VIEWS = ("paper11_11deg", "paper11_22deg", "paper11_33deg")
LAYOUT = "paper33_pitch"
"""Of every part that does not vary it."""

READING = Reading()
"""What the readings decided; every other part uses it."""

_TEXT: Mapping[str, Any] = {
    "inputs": "absolute",
    "variant": "batch-norm",
    "encoder_learning_rate": 0.0005,
    "first_bias": None,
}

TRIED: Mapping[str, Mapping[str, Any]] = {
    "the one chosen": {},
    "batch normalisation": {"variant": "batch-norm"},
    "absolute inputs": {"inputs": "absolute"},
    "PyTorch's last bias": {"first_bias": None},
    "100 rays a step": {"samples_per_batch": 1},
    "400 rays a step": {"samples_per_batch": 4},
    "3200 rays a step": {"samples_per_batch": PAPER_SAMPLES},
    "2 blocks": {"blocks": 2},
    "4 blocks": {"blocks": 4},
    "encoder's rate 0.0005": {"encoder_learning_rate": 0.0005},
    "encoder's rate 0.002": {"encoder_learning_rate": 0.002},
    "voxels' rate 0.003": {"voxel_learning_rate": 0.003},
    "norm over the step's weights": {"norm": "batch"},
    "no gradient normalisation": {"normalise_gradient": False},
    "absolute error as loss": {"loss": "absolute"},
    "voxels start up to 1": {"first_voxels": 1.0},
    "voxels start up to 1, no norm": {"first_voxels": 1.0, "normalise_gradient": False},
    "absolute inputs, in voxels": {"inputs": "unscaled"},
    "absolute inputs, in voxels, no norm": {"inputs": "unscaled", "normalise_gradient": False},
    "the text's figures, small steps": _TEXT,
    "the text's figures": {**_TEXT, "samples_per_batch": PAPER_SAMPLES},
}
"""How each reading differs from the one chosen.

The last has what the text says: its batches, rates and plain inputs. The one before takes as many
steps as the reading chosen, since the text's batches are few here.
"""

_LARGE_STEPS: Mapping[str, Any] = {"samples_per_batch": PAPER_SAMPLES}

TRIED_ON_NOISE: Mapping[str, tuple[str, float, Mapping[str, Any]]] = {
    "the one chosen": (LAYOUT, NOISE, {}),
    "3200 rays a step": (LAYOUT, NOISE, _LARGE_STEPS),
    "voxels' rate 0.001": (LAYOUT, NOISE, {"voxel_learning_rate": 0.001}),
    "3200 rays, voxels' rate 0.003": (
        LAYOUT,
        NOISE,
        {**_LARGE_STEPS, "voxel_learning_rate": 0.003},
    ),
    "3200 rays, batch normalisation": (
        LAYOUT,
        NOISE,
        {**_LARGE_STEPS, "variant": "batch-norm"},
    ),
    "the text's figures": (LAYOUT, NOISE, TRIED["the text's figures"]),
    "3200 rays, 10 % the limit": (LAYOUT, NOISE / 3**0.5, _LARGE_STEPS),
    "finer images, 3200 rays": (LAYOUT + FINER, NOISE, _LARGE_STEPS),
    "finer images, the text's figures": (LAYOUT + FINER, NOISE, TRIED["the text's figures"]),
}
"""What noisy images are reconstructed with: a layout, the noise, how the reading differs.

Noise of which 10 % is the limit, uniform below it, has the standard deviation of the row for it.
"""

_RELAXATIONS = (0.01, 0.03, 0.1, 0.3)
_PLAIN_RELAXATION, _PLAIN_SWEEPS = 1.0, 10
_PATIENCE = 5


def readings(sizes: Sizes, progress: Progress) -> Rows:
    """Return how near each reading comes on a coarser grid: the jet, and both flames noisy."""
    total = len(TRIED) + 2 * len(TRIED_ON_NOISE)
    rows: Rows = {"readings": [], "noisy_readings": []}

    def add(study: str, words: str, flame: str, layout: str, changes: Mapping, fraction: float):
        progress(sum(map(len, rows.values())), total, words)
        reading = replace(READING, **changes)
        row = trained(flame, layout, sizes.readings, sizes.reading_epochs, reading, noise=fraction)
        del row["section"]
        rows[study].append({"reading": words, **row})

    for words, changes in TRIED.items():
        add("readings", words, "jet", LAYOUT, changes, 0.0)
    for flame in ("jet", "turbulent"):
        for words, (layout, fraction, changes) in TRIED_ON_NOISE.items():
            add("noisy_readings", words, flame, layout, changes, fraction)
    return rows


def layouts(sizes: Sizes, progress: Progress) -> Rows:
    """Return the jet in the paper's three layouts; in the level one a row aside, and finer."""
    runs = [(layout, sizes.epochs_in_full) for layout in LAYOUTS]
    runs.append((FINER_LAYOUT, sizes.finer_epochs))
    rows = []
    for number, (layout, epochs) in enumerate(runs):
        progress(number, len(runs), layout)
        rows.append(trained("jet", layout, sizes.large, epochs, READING))
    return {"layouts": rows}


def views(sizes: Sizes, progress: Progress) -> Rows:
    """Return the turbulent flame with 33 views and with the three choices of 11."""
    rows = []
    for number, layout in enumerate((LAYOUT, *FEW_VIEWS)):
        progress(number, 1 + len(FEW_VIEWS), layout)
        rows.append(trained("turbulent", layout, sizes.problem, sizes.epochs, READING))
    return {"views": rows}


def ablation(sizes: Sizes, progress: Progress) -> Rows:
    """Return the jet with what can stand between a convolution and its Leaky ReLU."""
    rows = []
    for number, variant in enumerate(("no-bias", "bias-mask", "batch-norm")):
        progress(number, 3, variant)
        reading = replace(READING, variant=variant)
        rows.append(trained("jet", LAYOUT, sizes.problem, sizes.epochs, reading))
    return {"ablation": rows}


def normalisation(sizes: Sizes, progress: Progress) -> Rows:
    """Return the first losses, and whole runs, with and without gradient normalisation."""
    steps, rows = [], []
    for number, normalise in enumerate((True, False)):
        progress(number, 2, f"normalise_gradient {normalise}")
        reading = replace(READING, normalise_gradient=normalise)
        for variant in ("bias-mask", "batch-norm"):
            seen = case("jet", LAYOUT, sizes.problem)
            steps.append(first_steps(seen, replace(reading, variant=variant), sizes.first_steps))
        rows.append(trained("jet", LAYOUT, sizes.problem, sizes.epochs, reading))
    return {"first_steps": steps, "normalisation": rows}


def denoising(sizes: Sizes, progress: Progress) -> Rows:
    """Return noisy images, and finer ones, by WERNet and by ART."""
    rows, by_art = [], []
    large = replace(READING, samples_per_batch=PAPER_SAMPLES)
    for number, flame in enumerate(("jet", "turbulent")):
        progress(number, 2, flame)
        for layout, tried in ((LAYOUT, (READING, large)), (LAYOUT + FINER, (large,))):
            for reading in tried:
                rows.append(
                    trained(flame, layout, sizes.large, sizes.finer_epochs, reading, noise=NOISE)
                )
            seen = case(flame, layout, sizes.large, NOISE)
            measured = seen.whole.flatten(seen.images)
            for what, system, values in (
                ("all rays and voxels", seen.whole, measured),
                ("those left by carving", seen.system, seen.measured),
            ):
                by_art.append({"on": what, **_best_art(seen, system, values, sizes)})
            by_art.append({"on": "all rays and voxels", **_plain_art(seen, measured, sizes)})
    return {"denoising": rows, "art": by_art}


def transfer(sizes: Sizes, progress: Progress) -> Rows:
    """Return flames reconstructed with encoders trained on others, frozen and trained on."""
    homogeneous = Source("homogeneous", LAYOUT, sizes.homogeneous_epochs)
    jet = Source("jet", LAYOUT, sizes.epochs)
    turbulent = Source("turbulent", LAYOUT, sizes.epochs)
    ways = ((jet, "turbulent"), (turbulent, "jet"), (homogeneous, "jet"),
            (homogeneous, "turbulent"))  # fmt: skip
    rows = []
    for number, (source, flame) in enumerate(ways):
        for freeze in (True, False):
            words = f"{source.flame} to {flame}, {'frozen' if freeze else 'trained on'}"
            progress(2 * number + (not freeze), 2 * len(ways), words)
            rows.append(
                trained(
                    flame, LAYOUT, sizes.problem, sizes.transfer_epochs, READING,
                    source=source, freeze=freeze,
                )
            )  # fmt: skip
    own = trained("homogeneous", LAYOUT, sizes.problem, sizes.homogeneous_epochs, READING)
    return {"transfer": rows, "homogeneous": [own]}


def _best_art(
    seen: Case, system: LinearSystem, measured: NDArray[np.float32], sizes: Sizes
) -> dict[str, Any]:
    """Run ART with every relaxation; return the sweep nearest to the truth, of the best one."""
    best: dict[str, Any] = {}
    for relaxation in _RELAXATIONS:
        reached: list[float] = []

        def judge(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
            nonlocal best
            found = system.projector.active.expand(volume).reshape(seen.truth.shape)
            distance = metrics.cosine_distance(found, seen.truth)
            reached.append(distance)  # noqa: B023 - called within this turn of the loop only
            if distance < best.get("cosine_distance", np.inf):
                best = {"stopped": "best", **_art_row(seen, system, found, sizes)}
                best |= {"sweeps": index, "relaxation": relaxation}  # noqa: B023
            return index - int(np.argmin(reached)) >= _PATIENCE  # noqa: B023

        solvers.art(
            system.projector, measured, iterations=sizes.sweeps, relaxation=relaxation,
            callback=judge,
        )  # fmt: skip
    return best


def _plain_art(seen: Case, measured: NDArray[np.float32], sizes: Sizes) -> dict[str, Any]:
    """Return what ART's own step gives, neither relaxed nor stopped by the truth."""
    sweeps = min(_PLAIN_SWEEPS, sizes.sweeps)
    found = solvers.art(
        seen.whole.projector, measured, iterations=sweeps, relaxation=_PLAIN_RELAXATION
    ).volume
    row = {"stopped": "plain", **_art_row(seen, seen.whole, found, sizes)}
    return row | {"sweeps": sweeps, "relaxation": _PLAIN_RELAXATION}


def _art_row(
    seen: Case, system: LinearSystem, found: NDArray[np.float32], sizes: Sizes
) -> dict[str, Any]:
    return {
        "flame": seen.flame,
        "layout": seen.layout,
        "noise": seen.noise,
        "segments": system.projector.n_segments,
        "cosine_distance": metrics.cosine_distance(found, seen.truth),
        "nrmse": metrics.nrmse(found, seen.truth),
        "section": section(found, seen.truth, sizes.large),
    }


PARTS: Mapping[str, Callable[[Sizes, Progress], Rows]] = {
    "readings": readings,
    "layouts": layouts,
    "views": views,
    "ablation": ablation,
    "normalisation": normalisation,
    "denoising": denoising,
    "transfer": transfer,
}
