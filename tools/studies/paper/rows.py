"""Every training and every run of ART that the page shows, and the claims that they judge."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from studies.paper.cases import CASE_3, NOISE
from tomo import VoxelGrid
from tomo.wernet import VARIANTS, PaperSettings

EPOCHS, TRANSFER_EPOCHS, HOMOGENEOUS_EPOCHS, READING_EPOCHS = 80, 40, 10, 10
"""Epochs of a training from scratch, as in the text; of one with the encoder of another flame, of
which the text speaks up to epoch 40; of the homogeneous set, whose number the text does not give;
of a reading. Learning rates do not depend on the number, so fewer epochs are the first of more."""

FULL, HALF, TINY = (
    VoxelGrid((30, 140, 30), 0.5),
    VoxelGrid((15, 70, 15), 1.0),
    VoxelGrid((6, 28, 6), 2.5),
)


@dataclass(frozen=True)
class Row:
    """One training of the published network, or one run of ART."""

    name: str
    part: str  # the table that shows it
    flame: str
    layout: str = CASE_3
    noise: float = 0.0  # standard deviation over the images' maximum
    settings: PaperSettings = field(default=PaperSettings())
    # epochs, seed: the seed is that of encoder, first voxels and order of the rays
    epochs: int = EPOCHS
    seed: int = 0
    encoder_of: str = ""  # the row whose encoder it starts from; empty for a new one
    frozen: bool = False  # only the voxels are trained
    # "best": ART in place of the network, stopped nearest to the truth with the best of four
    # relaxations. "plain": neither relaxed nor stopped. Empty: the network
    art: str = ""
    grid: VoxelGrid = FULL

    @property
    def command(self) -> str:
        """The command that repeats it."""
        return f"python tools/paper.py --row {self.name} -o out/paper"


READINGS = {
    "chosen": {},
    "batch-norm": {"variant": "batch-norm"},
    "absolute": {"inputs": "absolute"},
    "initial-bias": {"last_bias": None},
    "100-rays": {"rays_per_step": 100},
    "400-rays": {"rays_per_step": 400},
    "3200-rays": {"rays_per_step": 3200},
    "2-blocks": {"blocks": 2},
    "4-blocks": {"blocks": 4},
    "16-channels": {"channels": 16},
    "slow-encoder": {"encoder_learning_rate": 0.0005},
    "plain-gradient": {"normalise_gradient": False},
    "absolute-error": {"loss": "absolute"},
    "large-start": {"voxel_start": 1.0},
    "text-small-steps": {
        "inputs": "absolute", "variant": "batch-norm", "encoder_learning_rate": 0.0005,
        "last_bias": None,
    },
    "text": {
        "inputs": "absolute", "variant": "batch-norm", "encoder_learning_rate": 0.0005,
        "last_bias": None, "rays_per_step": 3200,
    },
}  # fmt: skip
"""The fields in which each reading differs from the one chosen. The last is the text's."""


def _rows() -> list[Row]:
    chosen, plain = PaperSettings(), PaperSettings(normalise_gradient=False)
    rows = [
        Row("jet", "layouts", "jet"),
        Row("jet-level", "layouts", "jet", "case 1, level"),
        Row("jet-pitched", "layouts", "jet", "case 2, pitched"),
        Row("jet-on-faces", "layouts", "jet", "case 1, rows on faces"),
        Row("homogeneous", "transfer", "homogeneous", epochs=HOMOGENEOUS_EPOCHS),
        Row("homogeneous-to-jet", "transfer", "jet", encoder_of="homogeneous", frozen=True,
            epochs=TRANSFER_EPOCHS),
        Row("jet-noise-plain-art", "noise", "jet", noise=NOISE, art="plain"),
        Row("jet-noise-best-art", "noise", "jet", noise=NOISE, art="best"),
        Row("jet-noise", "noise", "jet", noise=NOISE),
        Row("turbulent", "views", "turbulent"),
        *(Row(f"turbulent-11-views-{step}-degrees", "views", "turbulent",
              f"11 views of {step} degrees") for step in (33, 22, 11)),
        *(Row(f"{source}-to-{flame}", "transfer", flame, encoder_of=source, frozen=True,
              epochs=TRANSFER_EPOCHS)
          for source, flame in (("jet", "turbulent"), ("turbulent", "jet"),
                                ("homogeneous", "turbulent"))),
        Row("homogeneous-to-turbulent-trained-on", "transfer", "turbulent",
            encoder_of="homogeneous", epochs=TRANSFER_EPOCHS),
        *(Row(f"turbulent-noise-{art}-art", "noise", "turbulent", noise=NOISE, art=art)
          for art in ("plain", "best")),
        Row("turbulent-noise", "noise", "turbulent", noise=NOISE),
        Row("jet-plain-gradient", "ablation", "jet", settings=plain),
        *(Row(f"jet-{variant}-seed-{seed}", "ablation", "jet", seed=seed,
              settings=PaperSettings(variant=variant))
          for seed in SEEDS for variant in VARIANTS
          if (variant, seed) != (chosen.variant, 0)),
        *(Row(f"{source}-to-{flame}-trained-on", "transfer", flame, encoder_of=source,
              epochs=TRANSFER_EPOCHS)
          for source, flame in (("homogeneous", "jet"), ("jet", "turbulent"),
                                ("turbulent", "jet"))),
        *(Row(f"{flame}-noise-3200-rays", "noise", flame, noise=NOISE,
              settings=PaperSettings(rays_per_step=3200)) for flame in ("jet", "turbulent")),
        *(Row(f"reading-{name}", "readings", "jet", grid=HALF, epochs=READING_EPOCHS,
              settings=PaperSettings(**changes)) for name, changes in READINGS.items()),
    ]  # fmt: skip
    return rows


SEEDS = (0, 1, 2)  # seeds of the ablation. Its row with bias and mask and seed 0 is ``jet``
ROWS = {row.name: row for row in _rows()}

PARTS = {
    "layouts": "Jet, three layouts of 33 cameras",
    "views": "Turbulent flame, 33 and 11 views",
    "ablation": "Parts of the network left out",
    "noise": "Noise of 10 % of the maximum",
    "transfer": "Encoders of other flames",
    "readings": "Readings of the text",
}


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
