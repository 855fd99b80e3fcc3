"""The claims of the paper, and what rows say about each."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from studies.paper.rows import SEEDS
from tomo.wernet import VARIANTS

Record = Mapping[str, Any]
Judge = Callable[..., tuple[str, bool]]
"""Takes the rows' figures; returns what was found, and whether the claim holds."""


@dataclass(frozen=True)
class Claim:
    """A claim, the rows that it needs, and the rule that judges it."""

    words: str
    rows: tuple[str, ...]
    judge: Judge

    def row(self, records: Mapping[str, Record]) -> dict[str, Any]:
        """Return its line of the table; found and holds are None until all rows are done."""
        found, holds = None, None
        if all(name in records for name in self.rows):
            found, holds = self.judge(*(records[name] for name in self.rows))
        return {"claim": self.words, "here": found, "holds": holds, "rows": ", ".join(self.rows)}


def _distance_below(limit: float) -> Judge:
    def judge(row: Record) -> tuple[str, bool]:
        return f"{row['cosine_distance']:.3g}", row["cosine_distance"] < limit

    return judge


def _similarity_above(limit: float) -> Judge:
    def judge(row: Record) -> tuple[str, bool]:
        return f"{1 - row['cosine_distance']:.4f}", 1 - row["cosine_distance"] > limit

    return judge


def _reaches_before(epoch: int, limit: float) -> Judge:
    def judge(row: Record) -> tuple[str, bool]:
        reached = [(1 - distance, n) for n, distance, _ in row["curve"] if n < epoch]
        first = next((n for similarity, n in reached if similarity > limit), None)
        best, at = max(reached)
        when = f", above {limit} from epoch {first}" if first else ""
        return f"{best:.5f} at epoch {at}{when}", first is not None

    return judge


def _many_views_are_better(many: Record, *few: Record) -> tuple[str, bool]:
    others = [row["cosine_distance"] for row in few]
    found = " ".join(f"{other:.3g}" for other in others)
    return f"{many['cosine_distance']:.3g} against {found}", many["cosine_distance"] < min(others)


def _first_is_better(ours: Record, other: Record) -> tuple[str, bool]:
    a, b = (1 - row["cosine_distance"] for row in (ours, other))
    return f"{a:.4f} against {b:.4f}", a > b


def _fails_without(without: Record, base: Record) -> tuple[str, bool]:
    a, b = (row["cosine_distance"] for row in (without, base))
    return f"{a:.3g} without, {b:.3g} with", a > 10 * b


def _no_bias_is_worst(*rows: Record) -> tuple[str, bool]:
    """Compare the medians of the seeds; rows come variant by variant."""
    size = len(SEEDS)
    parts = [rows[size * n : size * (n + 1)] for n in range(len(VARIANTS))]
    medians = [statistics.median(row["cosine_distance"] for row in part) for part in parts]
    words = ", ".join(f"{v} {m:.3g}" for v, m in zip(VARIANTS, medians, strict=True))
    return f"{words} (medians of {size} seeds)", medians[0] > max(medians[1:])


def of_variant(variant: str, seed: int) -> str:
    """Return the name of the ablation's row."""
    return "jet" if (variant, seed) == ("bias-mask", 0) else f"jet-{variant}-seed-{seed}"


_SEEDED = tuple(of_variant(variant, seed) for variant in VARIANTS for seed in SEEDS)
_FEW = tuple(f"turbulent-11-views-{step}-degrees" for step in (11, 22, 33))
_NEAR: Sequence[tuple[str, str]] = (
    ("level layout", "jet-level"),
    ("level layout, image rows on the faces of voxels", "jet-on-faces"),
    ("pitched layout", "jet-pitched"),
    ("pitched layout, random distances", "jet"),
)
CLAIMS = (
    *(
        Claim(f"jet, 33 views, {words}: distance below 0.001", (row,), _distance_below(1e-3))
        for words, row in _NEAR
    ),
    Claim(
        "turbulent flame: 33 views are better than 11 (steps of 11, 22, 33 degrees)",
        ("turbulent", *_FEW),
        _many_views_are_better,
    ),
    Claim("an encoder without bias is the worst of three variants", _SEEDED, _no_bias_is_worst),
    Claim(
        "without gradient normalisation the training fails",
        ("jet-plain-gradient", "jet"),
        _fails_without,
    ),
    *(
        Claim(f"{words}, 10 % noise: similarity above {how} ART's", (row, f"{row}-{art}-art"),
              _first_is_better)
        for words, row, art, how in (
            ("jet", "jet-noise", "plain", "unrelaxed"),
            ("jet", "jet-noise", "best", "best-stopped"),
            ("turbulent flame", "turbulent-noise", "plain", "unrelaxed"),
        )
    ),
    Claim(
        "turbulent flame, 10 % noise: similarity above 0.95",
        ("turbulent-noise",),
        _similarity_above(0.95),
    ),
    Claim(
        "encoder of the jet, frozen, for the turbulent flame: 0.99",
        ("jet-to-turbulent",),
        _similarity_above(0.99),
    ),
    Claim(
        "encoder of the turbulent flame, frozen, for the jet: 0.92",
        ("turbulent-to-jet",),
        _similarity_above(0.92),
    ),
    *(
        Claim(f"encoder of the homogeneous set, {words}: above 0.999 before epoch 40",
              (f"homogeneous-to-{row}",), _reaches_before(40, 0.999))
        for words, row in (
            ("frozen, for the jet", "jet"),
            ("frozen, for the turbulent flame", "turbulent"),
            ("trained on, for the jet", "jet-trained-on"),
            ("trained on, for the turbulent flame", "turbulent-trained-on"),
        )
    ),
)  # fmt: skip
"""In the order of the page."""
