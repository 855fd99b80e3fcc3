"""What the paper says, each beside what this run found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from _benchmark.tables import significant
from _results import Studies, judged

from _paper.cases import FINER
from _paper.sizes import PAPER_SAMPLES

Rows = Sequence[Mapping[str, Any]]

_EPOCHS, _MINUTES = 80, 8


@dataclass(frozen=True)
class Claim:
    """One statement of the paper.

    Attributes
    ----------
    what : str
    paper, ours : str
        In words.
    holds : bool
        Whether this run found it so.
    why : str
        Where the two differ, the reason as far as it is known.
    """

    what: str
    paper: str
    ours: str
    holds: bool
    why: str = ""

    def row(self) -> dict[str, Any]:
        """Return it as plain data; a reason is given only where the claim does not hold."""
        return {
            "what": self.what,
            "paper": self.paper,
            "ours": self.ours,
            "holds": self.holds,
            "why": "" if self.holds else self.why,
        }


def claims(studies: Studies) -> list[dict[str, Any]]:
    """Return the claims that the studies at hand say something about."""
    return judged(studies, _JUDGES)


def short(layout: str) -> str:
    """Return ``33 views, level`` for ``paper33_level``."""
    views, kind = layout.removeprefix("paper").removesuffix(FINER).split("_", 1)
    words = f"{views} views, {kind.replace('deg', ' degrees apart').replace('_', ' ')}"
    return words + ", finer images" * layout.endswith(FINER)


def _similarity(distance: float) -> str:
    return f"similarity {1 - distance:.4f}"


def _layouts(rows: Rows) -> Iterator[Claim]:
    for row in rows:
        distance = row["cosine_distance"]
        yield Claim(
            f"Jet, {short(row['layout'])}, {row['epochs']} epochs",
            "distance below 0.001",
            f"{significant(distance)}",
            distance < 1e-3,
            _WHY_LAYOUTS,
        )
    coarse = [row for row in rows if not row["layout"].endswith(FINER)]
    slowest = max(row["core_seconds_per_epoch"] for row in coarse) * _EPOCHS / 60
    yield Claim(
        f"Jet, time of {_EPOCHS} epochs",
        f"(this project's aim) below {_MINUTES} minutes on 2 cores",
        f"{significant(slowest, 2)} minutes of one core",
        slowest < _MINUTES,
    )


def _views(rows: Rows) -> Iterator[Claim]:
    many, few = (
        [row["cosine_distance"] for row in rows if row["layout"].startswith(f"paper{views}_")]
        for views in (33, 11)
    )
    if many and few:
        yield Claim(
            "Turbulent flame, 33 views against 11",
            "33 views are nearer to the truth",
            f"{significant(many[0])} against {', '.join(significant(d) for d in few)}",
            many[0] < min(few),
        )


def _ablation(rows: Rows) -> Iterator[Claim]:
    distances = {row["variant"]: row["cosine_distance"] for row in rows}
    yield Claim(
        "Jet, encoder without bias",
        "worst of the three variants",
        ", ".join(f"{name} {significant(d)}" for name, d in distances.items()),
        distances["no-bias"] == max(distances.values()),
        _WHY_ABLATION,
    )


def _normalisation(rows: Rows) -> Iterator[Claim]:
    on, off = (
        next(row["cosine_distance"] for row in rows if row["normalise_gradient"] is n)
        for n in (True, False)
    )
    yield Claim(
        "Jet, without gradient normalisation",
        "training fails",
        f"{significant(off)} without, {significant(on)} with",
        off > 10 * on,
        _WHY_NORMALISATION,
    )


def _denoising(rows: Rows, by_art: Rows) -> Iterator[Claim]:
    for row in rows:
        if row["samples_per_batch"] != PAPER_SAMPLES:
            continue
        art = [r for r in by_art if (r["flame"], r["layout"]) == (row["flame"], row["layout"])]
        best = [1 - r["cosine_distance"] for r in art if r["stopped"] == "best"]
        plain = next(1 - r["cosine_distance"] for r in art if r["stopped"] == "plain")
        ours, turbulent = 1 - row["cosine_distance"], row["flame"] == "turbulent"
        where = f"{row['flame'].capitalize()}, 10 % noise"
        where += ", finer images" * row["layout"].endswith(FINER)
        if turbulent:
            yield Claim(
                where,
                "similarity above 0.95",
                _similarity(row["cosine_distance"]),
                ours > 0.95,
                _WHY_NOISE,
            )
        said = "nearer to the truth" + ", 0.95 against 0.87" * turbulent
        yield Claim(
            f"{where}, against ART not relaxed",
            said,
            f"{ours:.4f} against {plain:.4f}",
            ours > plain,
            _WHY_NOISE,
        )
        yield Claim(
            f"{where}, against ART relaxed and stopped best",
            said,
            f"{ours:.4f} against {best[0]:.4f} ({best[1]:.4f} on what carving left)",
            ours > max(best),
            _WHY_ART,
        )


def _noisy_readings(rows: Rows) -> Iterator[Claim]:
    finer = [row for row in rows if row["layout"].endswith(FINER) and row["flame"] == "turbulent"]
    if finer:
        best = min(finer, key=lambda row: row["cosine_distance"])
        distance = best["cosine_distance"]
        yield Claim(
            "Turbulent, 10 % noise, finer images, the readings' wider voxels",
            "similarity above 0.95",
            _similarity(distance),
            distance < 0.05,
            _WHY_NOISE,
        )


def _transfer(rows: Rows) -> Iterator[Claim]:
    said = {("jet", "turbulent"): 0.99, ("turbulent", "jet"): 0.92}
    for row in rows:
        way = f"Encoder of the {row['encoder_of']} case for the {row['flame']} flame"
        way += ", frozen" if row["frozen"] else ", trained on"
        wanted = said.get((row["encoder_of"], row["flame"]))
        distance = row["cosine_distance"]
        if wanted is not None:
            yield Claim(way, f"similarity {wanted}", _similarity(distance),
                        1 - distance >= wanted, _WHY_TRANSFER)  # fmt: skip
            continue
        before_40 = [d for epoch, d, _ in row["course"] if epoch < 40]
        reached = [epoch for epoch, d, _ in row["course"] if d < 1e-3]
        words = f"{_similarity(min(before_40, default=1.0))} before epoch 40"
        words += f", above 0.999 from epoch {reached[0]}" if reached else ", never above 0.999"
        holds = bool(reached) and reached[0] < 40
        yield Claim(way, "above 0.999 in fewer than 40 epochs", words, holds, _WHY_TRANSFER)


_WHY_LAYOUTS = (
    "the images' rows fall on the voxels' faces: see `level shifted` and the finer images"
)
_WHY_ABLATION = (
    "one seed only; likely the statistics of 200 rays a step are too "
    "unsteady for batch normalisation"
)
_WHY_NORMALISATION = (
    "Adam divides every voxel's step by the size of its own gradients, which nearly cancels the "
    "rays' factors; where voxels start larger it does help, see the readings"
)
_WHY_NOISE = (
    "free voxels fit the noise, and only more rays a voxel average it: finer images come nearer, "
    "on wider voxels nearer still, see the readings"
)
_WHY_ART = "stopping and small steps keep noise out of ART; the truth, which told when, is unknown"
_WHY_TRANSFER = "one seed; encoders and voxels were trained for fewer epochs than in the paper"

_JUDGES: tuple[tuple[tuple[str, ...], Callable[..., Iterator[Claim]]], ...] = (
    (("layouts",), _layouts),
    (("views",), _views),
    (("ablation",), _ablation),
    (("normalisation",), _normalisation),
    (("denoising", "art"), _denoising),
    (("noisy_readings",), _noisy_readings),
    (("transfer",), _transfer),
)
