"""What calibration sets out to reach, each beside what the study found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from _benchmark.claims import Claim
from _benchmark.tables import significant
from _results import Studies, judged

from _calibration.cases import CASES

MOST_RAY_MISS = {"arc": 0.003, "ring": 0.005}
MOST_RATIO = 1.5
LEAST_GAIN = {"arc_complete": 4.0, "ring_complete": 1.0}
MOST_SECONDS = 20.0
STEREO = {"left_rms_px": 0.409, "right_rms_px": 0.459, "joint_rms_px": 0.445}
BASELINE, BASELINE_WITHIN = 3.338, 0.01


def claims(studies: Studies) -> list[dict[str, Any]]:
    """Return the claims that the studies at hand say something about."""
    return judged(studies, _JUDGES)


def best_of_peer(rows: Sequence[Mapping[str, Any]], case: str, seed: int) -> float | None:
    """Return the least true ray-miss of OpenCV's settings; None where all threw."""
    mine = [row["true_ray_miss"] for row in rows if (row["case"], row["seed"]) == (case, seed)]
    return min((miss for miss in mine if miss is not None), default=None)


def _rendered(rows: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    for name, mine in _by_case(rows):
        words, layout = _words(name), name.split("_")[0]
        worst = max(row["true_ray_miss"] for row in mine)
        what = f"{words}: true ray-miss, worst of {len(mine)} rigs"
        yield Claim(what, worst, MOST_RAY_MISS[layout], at_least=False, unit="mm")
    for name, mine in _by_case(rows):
        off = max(_off(row) for row in mine)
        ratios = ", ".join(
            significant(row["true_ray_miss"] / row["predicted_ray_miss"]) for row in mine
        )
        what = f"{_words(name)}: true over predicted ray-miss or its inverse ({ratios})"
        yield Claim(what, off, MOST_RATIO, at_least=False)
    largest = max(abs(row["true_ray_miss_from_metres"] / row["true_ray_miss"] - 1) for row in rows)
    what = "the same targets in metres: relative difference of the true ray-miss"
    yield Claim(what, largest, 1e-3, at_least=False, unit="")


def _peer(
    rows: Sequence[Mapping[str, Any]], peers: Sequence[Mapping[str, Any]]
) -> Iterator[Claim]:
    for name, mine in _by_case(rows):
        if name not in LEAST_GAIN:
            continue
        gains = []
        for row in mine:
            best = best_of_peer(peers, name, row["seed"])
            if best is not None:
                gains.append(best / row["true_ray_miss"])
        what = f"{_words(name)}: cv2.calibrateMultiview's true ray-miss over this one's, worst"
        yield Claim(what, min(gains, default=None), LEAST_GAIN[name])


def _stereo(rows: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    row = rows[0]
    for key, most in STEREO.items():
        words = key.removesuffix("_rms_px")
        what = f"chessboard pairs, {words}: RMS"
        yield Claim(what, row[key], most, at_least=False, unit="px")
    what = "chessboard pairs: points left out"
    yield Claim(what, row["points_left_out"], 0, at_least=False, unit="")
    what = f"chessboard pairs: baseline's distance from {BASELINE}, see below"
    off = abs(row["baseline"] - BASELINE)
    yield Claim(what, off, BASELINE_WITHIN, at_least=False, unit="squares")
    same = next(r for r in rows[1:] if r["corners"] == row["corners"])
    what = "chessboard pairs: baseline's distance from cv2.stereoCalibrate's, the same corners"
    off = abs(row["baseline"] - same["baseline"])
    yield Claim(what, off, BASELINE_WITHIN, at_least=False, unit="squares")


def _timing(rows: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    row = rows[0]
    what = f"{row['cameras']} cameras x {row['frames']} frames: work of the two cores"
    yield Claim(what, row["core_seconds"], MOST_SECONDS, at_least=False, unit="s")


def _off(row: Mapping[str, Any]) -> float:
    ratio = row["true_ray_miss"] / row["predicted_ray_miss"]
    return max(ratio, 1 / ratio)


def _by_case(rows: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, list]]:
    for name in dict.fromkeys(row["case"] for row in rows):
        yield name, [row for row in rows if row["case"] == name]


def _words(name: str) -> str:
    return next(case.words for case in CASES if case.name == name)


_JUDGES: tuple[tuple[tuple[str, ...], Callable[..., Iterator[Claim]]], ...] = (
    (("rendered",), _rendered),
    (("rendered", "peer"), _peer),
    (("stereo",), _stereo),
    (("timing",), _timing),
)
