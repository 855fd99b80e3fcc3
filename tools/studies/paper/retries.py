"""What did not hold, once more under the paper's own conditions.

The flame is as hard for ART as the paper's was, trainings have the paper's 80 epochs, and the
variants of the encoder are compared on three seeds.
"""

from __future__ import annotations

import statistics
from dataclasses import replace
from typing import Any

from studies.common.study import Request, Tables
from studies.paper.cases import LARGER, NOISE, case
from studies.paper.experiments import LAYOUT, READING, _claim, _drawn, _plain_art
from studies.paper.sizes import PAPER_SAMPLES, SIZES, Sizes
from studies.paper.training import Source, trained

ART_OF_PAPER, WERNET_OF_PAPER = 0.87, 0.95
"""Cosine similarities that the paper gives for its turbulent flame with noise of 10 %."""

SIZES_OF_FLAME = (1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0)
"""Times the box: of these, the flame for which ART comes nearest to the paper's is taken."""

SEEDS = (0, 1, 2)

_REACHED = "epochs cosine_distance best_cosine_distance best_epoch nrmse core_seconds_per_epoch"
COLUMNS = {
    "flames": "flame art_similarity nrmse",
    "smoother": f"flame samples_per_batch rays {_REACHED}",
    "seeds": f"variant seed {_REACHED}",
    "variants": "variant median least most",
    "longer": f"encoder_of flame frozen {_REACHED}",
    "claims": "case paper found agrees",
}


def smoother(request: Request) -> Tables:
    """Enlarge the turbulent flame until ART, not relaxed, is as near to it as to the paper's.

    Noise has a standard deviation of a tenth of the brightest pixel; pixels are as wide as voxels.
    """
    sizes, flames = SIZES[request.size], []
    for number, times in enumerate(SIZES_OF_FLAME):
        name = f"turbulent{LARGER}{times:g}"
        request.progress(number, len(SIZES_OF_FLAME) + 2, name)
        flames.append(_by_art(name, sizes))
    chosen = min(flames, key=lambda row: abs(row["art_similarity"] - ART_OF_PAPER))["flame"]
    rows = []
    for number, samples in enumerate((READING.samples_per_batch, PAPER_SAMPLES)):
        request.progress(len(SIZES_OF_FLAME) + number, len(SIZES_OF_FLAME) + 2, chosen)
        reading = replace(READING, samples_per_batch=samples)
        epochs = sizes.epochs_in_full
        rows.append(trained(chosen, LAYOUT, sizes.large, epochs, reading, noise=NOISE))
    claims = []
    for row in rows:
        what = f"{chosen}, {100 * row['samples_per_batch']} rays a step"
        for when, key in (
            ("", "cosine_distance"),
            ("at its best epoch, ", "best_cosine_distance"),
        ):
            reached = 1 - row[key] >= WERNET_OF_PAPER
            words = f"{when}similarity {WERNET_OF_PAPER}"
            claims.append(_claim(what, words, {"cosine_distance": row[key]}, reached))
    return {"flames": flames, "smoother": rows, "claims": claims}


def seeds(request: Request) -> Tables:
    """Train three variants of the encoder on the jet, from three seeds."""
    sizes, rows = SIZES[request.size], []
    variants = ("no-bias", "bias-mask", "batch-norm")
    runs = [(seed, variant) for seed in SEEDS for variant in variants]
    for number, (seed, variant) in enumerate(runs):
        request.progress(number, len(runs), f"{variant}, seed {seed}")
        reading = replace(READING, variant=variant, seed=seed)
        rows.append(trained("jet", LAYOUT, sizes.problem, sizes.epochs_in_full, reading))
    found = [_spread(variant, rows) for variant in variants]
    worst = found[0]["median"] == max(one["median"] for one in found)
    row = {"cosine_distance": found[0]["median"]}
    claims = [_claim("jet, no bias, median of three seeds", "worst of three", row, worst)]
    return {"seeds": rows, "variants": found, "claims": claims}


def longer(request: Request) -> Tables:
    """Train the turbulent flame for 80 epochs with an encoder of the homogeneous set."""
    sizes, rows, claims = SIZES[request.size], [], []
    source = Source("homogeneous", LAYOUT, sizes.homogeneous_epochs)
    for freeze in (True, False):
        what = f"homogeneous to turbulent, {'frozen' if freeze else 'trained on'}"
        request.progress(int(not freeze), 2, what)
        row = trained(
            "turbulent", LAYOUT, sizes.problem, sizes.epochs_in_full, READING,
            source=source, freeze=freeze,
        )  # fmt: skip
        rows.append(row)
        claims.append(_claim(what, "similarity 0.999", row, row["cosine_distance"] <= 1e-3))
    return {"longer": rows, "claims": claims}


def _by_art(name: str, sizes: Sizes) -> dict[str, Any]:
    seen = case(name, LAYOUT, sizes.large, NOISE)
    row = _plain_art(seen, seen.whole.flatten(seen.images), sizes)
    return {"art_similarity": 1 - row["cosine_distance"], **row}


def _spread(variant: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    own = [row["cosine_distance"] for row in rows if row["variant"] == variant]
    return {
        "variant": variant, "median": statistics.median(own), "least": min(own), "most": max(own),
    }  # fmt: skip


PLOTS = {
    "smoother": lambda tables: _drawn(tables, "smoother", ("samples_per_batch",)),
    "seeds": lambda tables: _drawn(tables, "seeds", ("variant", "seed")),
    "longer": lambda tables: _drawn(tables, "longer", ("encoder_of", "frozen")),
}
