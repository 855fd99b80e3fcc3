"""The paper's experiments: each part trains what it needs and returns rows and claims.

Flames are this project's phantoms, not the paper's data. Images are the true voxels projected
through the chord lengths of those same voxels, which is taken to be the paper's way. What the text
leaves open was decided on the jet (`Reading`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.common.axes import curves
from studies.common.study import Request, Tables
from studies.paper.cases import FINER, NOISE, SHIFTED, Case, case
from studies.paper.sizes import PAPER_SAMPLES, SIZES, Sizes
from studies.paper.training import Reading, Source, trained
from tomo import LinearSystem, metrics, solvers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAYOUTS = ("paper33_level", "paper33_pitch", "paper33_random", "paper33_level" + SHIFTED)
FINER_LAYOUT = "paper33_level" + FINER
FEW_VIEWS = ("paper11_11deg", "paper11_22deg", "paper11_33deg")
LAYOUT = "paper33_pitch"
"""The layout of every part that does not vary it."""

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
    "no gradient normalisation": {"normalise_gradient": False},
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


_REACHED = "epochs cosine_distance best_cosine_distance best_epoch nrmse core_seconds_per_epoch"
_CLAIMS = "case paper found agrees"
COLUMNS = {
    "readings": f"flame reading {_REACHED}",
    "layouts": f"layout rays segments live_voxels {_REACHED}",
    "views": f"layout views rays {_REACHED}",
    "ablation": f"variant {_REACHED}",
    "normalisation": f"normalise_gradient {_REACHED}",
    "denoising": f"flame layout samples_per_batch rays {_REACHED}",
    "art": "flame layout on stopped relaxation sweeps cosine_distance nrmse",
    "transfer": f"encoder_of flame frozen {_REACHED}",
    "claims": _CLAIMS,
}


def readings(request: Request) -> Tables:
    """Change in each row what it names in the reading chosen; the last ones have 10 % noise.

    3200 rays a step, 32 samples of 100, are the paper's; its images gave it at least 96 steps an
    epoch, for which `the text's figures, small steps` stands. With absolute inputs the encoder can
    hide a smooth factor in the weights.
    """
    sizes, rows = SIZES[request.size], []
    runs = [("jet", words, LAYOUT, 0.0, changes) for words, changes in TRIED.items()]
    runs += [
        (flame, f"noise: {words}", layout, fraction, changes)
        for flame in ("jet", "turbulent")
        for words, (layout, fraction, changes) in TRIED_ON_NOISE.items()
    ]
    for number, (flame, words, layout, fraction, changes) in enumerate(runs):
        request.progress(number, len(runs), words)
        reading = replace(READING, **changes)
        row = trained(flame, layout, sizes.readings, sizes.reading_epochs, reading, noise=fraction)
        rows.append({"reading": words, **row})
    return {"readings": rows}


def layouts(request: Request) -> Tables:
    """Compare layouts: in the level one, image rows fall on the faces between voxel layers.

    They do so in every view alike. One row less at the images' top (`shifted`) puts them at the
    layers' middles, and nothing else; in the finer images no row falls on a face. Height in the
    voxel then tells the encoder how deep a segment is, so that a smooth factor can hide in the
    weights, as with absolute inputs.
    """
    sizes = SIZES[request.size]
    runs = [(layout, sizes.epochs_in_full) for layout in LAYOUTS]
    runs.append((FINER_LAYOUT, sizes.finer_epochs))
    rows = []
    for number, (layout, epochs) in enumerate(runs):
        request.progress(number, len(runs), layout)
        rows.append(trained("jet", layout, sizes.large, epochs, READING))
    claims = (
        _claim(f"jet, {row['layout']}", "distance below 0.001", row, row["cosine_distance"] < 1e-3)
        for row in rows
    )
    return {"layouts": rows, "claims": list(claims)}


def views(request: Request) -> Tables:
    """Compare 33 views of the turbulent flame with 11 that cover 121, 242 and 363 degrees."""
    sizes, rows = SIZES[request.size], []
    for number, layout in enumerate((LAYOUT, *FEW_VIEWS)):
        request.progress(number, 1 + len(FEW_VIEWS), layout)
        rows.append(trained("turbulent", layout, sizes.problem, sizes.epochs, READING))
    many, *few = (row["cosine_distance"] for row in rows)
    claim = _claim("turbulent, 33 views", "nearer than 11 views", rows[0], many < min(few))
    return {"views": rows, "claims": [claim]}


def ablation(request: Request) -> Tables:
    """Vary what stands between a convolution and its Leaky ReLU, on the jet."""
    sizes, rows = SIZES[request.size], []
    for number, variant in enumerate(("no-bias", "bias-mask", "batch-norm")):
        request.progress(number, 3, variant)
        reading = replace(READING, variant=variant)
        rows.append(trained("jet", LAYOUT, sizes.problem, sizes.epochs, reading))
    distances = [row["cosine_distance"] for row in rows]
    worst = distances[0] == max(distances)
    return {"ablation": rows, "claims": [_claim("jet, no bias", "worst of three", rows[0], worst)]}


def normalisation(request: Request) -> Tables:
    """Train on the jet with and without gradient normalisation."""
    sizes, rows = SIZES[request.size], []
    for number, normalise in enumerate((True, False)):
        request.progress(number, 2, f"normalise_gradient {normalise}")
        reading = replace(READING, normalise_gradient=normalise)
        rows.append(trained("jet", LAYOUT, sizes.problem, sizes.epochs, reading))
    fails = rows[1]["cosine_distance"] > 10 * rows[0]["cosine_distance"]
    claims = [_claim("jet, no gradient normalisation", "training fails", rows[1], fails)]
    return {"normalisation": rows, "claims": claims}


def denoising(request: Request) -> Tables:
    """Add white noise whose standard deviation is a tenth of the brightest pixel.

    ART is Kaczmarz sweeps with non-negativity: stopped nearest to the truth with the best of four
    relaxations, and not relaxed, after ten sweeps.
    """
    sizes, rows, by_art, claims = SIZES[request.size], [], [], []
    large = replace(READING, samples_per_batch=PAPER_SAMPLES)
    for number, flame in enumerate(("jet", "turbulent")):
        request.progress(number, 2, flame)
        for layout, tried in ((LAYOUT, (READING, large)), (LAYOUT + FINER, (large,))):
            for reading in tried:
                rows.append(
                    trained(flame, layout, sizes.large, sizes.finer_epochs, reading, noise=NOISE)
                )
            seen = case(flame, layout, sizes.large, NOISE)
            measured = seen.whole.flatten(seen.images)
            best = _best_art(seen, seen.whole, measured, sizes)
            plain = _plain_art(seen, measured, sizes)
            by_art += [best, plain]
            ours = rows[-1]["cosine_distance"]
            for other in (best, plain):
                what = f"{flame}, {layout}: against ART, stopped {other['stopped']}"
                nearer = ours < other["cosine_distance"]
                claims.append(_claim(what, "nearer to the truth", rows[-1], nearer))
            if flame == "turbulent":
                claims.append(_claim(layout, "similarity above 0.95", rows[-1], ours < 0.05))
    return {"denoising": rows, "art": by_art, "claims": claims}


def transfer(request: Request) -> Tables:
    """Start from the encoder of a training of its own on another flame; voxels start afresh.

    `frozen`: only the voxels are trained.
    """
    sizes = SIZES[request.size]
    homogeneous = Source("homogeneous", LAYOUT, sizes.homogeneous_epochs)
    jet = Source("jet", LAYOUT, sizes.epochs)
    turbulent = Source("turbulent", LAYOUT, sizes.epochs)
    ways = ((jet, "turbulent", 0.99), (turbulent, "jet", 0.92), (homogeneous, "jet", 0.999),
            (homogeneous, "turbulent", 0.999))  # fmt: skip
    rows, claims = [], []
    for number, (source, flame, least) in enumerate(ways):
        for freeze in (True, False):
            what = f"{source.flame} to {flame}, {'frozen' if freeze else 'trained on'}"
            request.progress(2 * number + (not freeze), 2 * len(ways), what)
            row = trained(
                flame, LAYOUT, sizes.problem, sizes.transfer_epochs, READING,
                source=source, freeze=freeze,
            )  # fmt: skip
            reached = 1 - row["best_cosine_distance"] >= least
            claims.append(_claim(what, f"similarity {least}", row, reached))
            rows.append(row)
    return {"transfer": rows, "claims": claims}


def _claim(case: str, paper: str, row: Mapping[str, Any], agrees: bool) -> dict[str, Any]:
    return {"case": case, "paper": paper, "found": row["cosine_distance"], "agrees": bool(agrees)}


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
                best = {"stopped": "best", **_art_row(seen, system, found)}
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
    row = {"stopped": "plain", **_art_row(seen, seen.whole, found)}
    return row | {"sweeps": sweeps, "relaxation": _PLAIN_RELAXATION}


def _art_row(seen: Case, system: LinearSystem, found: NDArray[np.float32]) -> dict[str, Any]:
    return {
        "flame": seen.flame,
        "layout": seen.layout,
        "segments": system.projector.n_segments,
        "cosine_distance": metrics.cosine_distance(found, seen.truth),
        "nrmse": metrics.nrmse(found, seen.truth),
    }


def _drawn(tables: Tables, table: str, keys: Sequence[str]) -> Figure | None:
    """Return cosine distance against epoch: a panel for each flame, a curve for each row."""
    panels: dict[str, dict[str, Iterable]] = {}
    for row in tables.get(table, ()):
        name = ", ".join(str(row[key]) for key in keys)
        points = [(epoch, distance) for epoch, distance, _ in row["curves"]]
        panels.setdefault(row["flame"], {})[name] = points
    return curves(panels, "epoch", "cosine distance") if panels else None


PLOTS = {
    "readings": lambda tables: _drawn(tables, "readings", ("reading",)),
    "layouts": lambda tables: _drawn(tables, "layouts", ("layout",)),
    "views": lambda tables: _drawn(tables, "views", ("layout",)),
    "ablation": lambda tables: _drawn(tables, "ablation", ("variant",)),
    "normalisation": lambda tables: _drawn(tables, "normalisation", ("normalise_gradient",)),
    "denoising": lambda tables: _drawn(tables, "denoising", ("layout", "samples_per_batch")),
    "transfer": lambda tables: _drawn(tables, "transfer", ("encoder_of", "frozen")),
}
