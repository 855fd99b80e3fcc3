"""The figures of a series, its answer in one sentence, and how far to trust it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.pipeline.answer import EXPLAINED, HARMFUL, NOT_EXPLAINED, PARTLY, percent
from tomo.pipeline.answer import UNKNOWN_VERDICT as UNKNOWN
from tomo.pipeline.verdict import (
    GREEN,
    LEVELS,
    RULES,
    Rule,
    Verdict,
    judge,
    rules_that_apply,
    worst_of,
)
from tomo.series.layout import CAMERA_FIGURES, FIGURES
from tomo.series.store import SeriesStore


@dataclass(frozen=True)
class SeriesAnswer:
    """Whether the volumes of a series explain their images; the verdict is the middle frame's."""

    verdict: str
    sentence: str
    explained: int = 0
    partly: int = 0
    not_explained: int = 0
    unknown: int = 0


def verdict_of_frame(worst: float) -> str:
    """Return whether a frame is explained, from its worst image's residual beyond noise."""
    return NOT_EXPLAINED if worst > HARMFUL else PARTLY if worst else EXPLAINED


def answer_of_series(
    table: Mapping[str, NDArray], frames: Sequence[int], cameras: Sequence[str]
) -> SeriesAnswer:
    """Return the answer from the figures of the frames.

    ``table`` has ``view_beyond_noise`` ``(frames, cameras)``, NaN of dark images and of excluded
    cameras; ``psnr``, optional: where it is known, a camera was held out and does not count; and
    ``complete`` ``(frames,)``.
    """
    beyond, complete = np.asarray(table["view_beyond_noise"]), np.asarray(table["complete"]) == 1
    if "psnr" in table:
        beyond = np.where(np.isfinite(table["psnr"]), np.nan, beyond)
    lit = complete & np.isfinite(beyond).any(axis=1)
    count, unknown = int(complete.sum()), int((complete & ~lit).sum())
    if not lit.any():
        sentence = "Not known: no frame has an image with light to compare its volume with."
        return SeriesAnswer(UNKNOWN, sentence, unknown=unknown)
    worst = np.nanmax(beyond[lit], axis=1)
    explained = int((worst == 0).sum())
    missed = int((worst > HARMFUL).sum())
    partly = len(worst) - explained - missed
    middle = float(np.median(worst))
    verdict = verdict_of_frame(middle)
    place = np.flatnonzero(lit)[int(np.argmax(worst))]
    camera = cameras[int(np.nanargmax(beyond[place]))]
    parts = [
        f"{f'all {count}' if number == count else f'{number} of {count}'} frames {words}"
        for number, words in (
            (explained, "are explained up to their noise"),
            (partly, f"but for up to {HARMFUL:.0%} of an image"),
            (missed, f"miss more than {HARMFUL:.0%} of an image"),
            (unknown, "are dark"),
        )
        if number
    ]
    sentence = (
        f"{verdict.capitalize()}: {', '.join(parts)}; least well frame {frames[place]}, where "
        f"camera {camera} is off by {percent(worst.max())} beyond the noise (middle frame "
        f"{percent(middle)})."
    )
    return SeriesAnswer(verdict, sentence, explained, partly, missed, unknown)


@dataclass(frozen=True, eq=False)
class SeriesTable:
    """The figures of a series: of each frame, or of each frame and camera; NaN where none is."""

    store: SeriesStore
    frames: NDArray[np.int64]
    times: NDArray[np.float64]
    columns: Mapping[str, NDArray]

    @classmethod
    def of(cls, store: SeriesStore) -> SeriesTable:
        """Read the figures of a store."""
        columns = {name: store.values(name) for name in (*FIGURES, *CAMERA_FIGURES)}
        columns["complete"] = store.states
        return cls(store, store.values("frame"), store.values("time"), columns)

    @property
    def cameras(self) -> list[str]:
        """The names of the cameras, in the order of the columns."""
        return self.store.attributes["cameras"]

    def known(self, name: str) -> NDArray[np.float64]:
        """Return the finite values of a figure of frames."""
        values = self.columns[name]
        return values[np.isfinite(values)]

    def each_camera(self, name: str) -> dict[str, NDArray[np.float64]]:
        """Return a figure's column of each camera that has it, NaN where a frame has none."""
        columns = dict(zip(self.cameras, self.columns[name].T, strict=True))
        return {camera: own for camera, own in columns.items() if np.isfinite(own).any()}

    def label(self, place: int) -> str:
        """Return words for a frame: its number, and its time where that is known."""
        unit = self.store.attributes["time_unit"]
        time = "" if unit == "1" else f", {self.times[place]:.6g} {unit}"
        return f"frame {self.frames[place]}{time}"


def verdict_of_series(table: SeriesTable) -> dict[str, Any]:
    """Return the verdict of a series, as ``--json`` has it: the worst frame's, and counts of all.

    A reason that not all frames share says how many do, in the words of the frame explained least.
    The cameras, which are settled once, are in the verdict of every frame.
    """
    frames = list(_frames(table))
    if not frames:
        return Verdict(LEVELS[-1], ("no frame is complete",)).report() | {"frames": {}}
    frames.sort(key=_unexplained)
    verdicts = [judge(facts) for facts in frames]
    counts = {one: sum(v.level == one for v in verdicts) for one in LEVELS}
    level = worst_of(verdicts)
    if level == GREEN:
        found = verdicts[-1]
    else:
        lines = _lines(frames)
        order = sorted(lines, key=lambda one: -LEVELS.index(one.level))
        reasons = [line for rule in order for line in lines[rule][0]]
        steps = dict.fromkeys(step for _, own in lines.values() for step in own if step)
        if counts[level] < len(frames):
            shares = ", ".join(f"{n} {one}" for one, n in counts.items() if n)
            reasons.insert(0, f"of {len(frames)} frames {shares}")
        found = Verdict(level, tuple(reasons), tuple(steps))
    return found.report() | {"frames": counts}


def _lines(frames: list[dict[str, Any]]) -> dict[Rule, tuple[list[str], list[str]]]:
    """Return the reasons and steps of each rule that applies, in the rules' order.

    One that some frames meet, or each with other figures, has the words of the last frame.
    """
    met = [rules_that_apply(facts) for facts in frames]
    lines = {}
    for rule in RULES:
        own = [[values for one, values in frame if one is rule] for frame in met]
        last = next((values for values in reversed(own) if values), None)
        if last is None:
            continue
        number = sum(map(bool, own))
        begin = "" if number == len(frames) else f"in {number} of {len(frames)} frames "
        reasons = [begin + rule.reason.format(**values) for values in last]
        lines[rule] = reasons, [rule.step.format(**values) for values in last]
    return lines


def _unexplained(facts: Mapping[str, Any]) -> float:
    return facts["answer"]["beyond_noise"] or 0.0


def _frames(table: SeriesTable) -> Iterator[dict[str, Any]]:
    """Yield what ``report.json`` would say of each complete frame, as far as the store knows."""
    about = table.store.attributes
    plan, held_out = about["plan"], about["options"].get("hold_out") or []
    excluded = (plan.get("screening") or {}).get("excluded") or []
    common = {k: plan.get(k) for k in ("findings", "refinement")}
    common["uncertainty"] = {"voxels": plan.get("voxels")}
    cameras = (about.get("rig") or {}).get("cameras") or ()
    status = {one["name"]: one.get("status") for one in cameras}
    beyond = table.columns["view_beyond_noise"]
    for place in np.flatnonzero(table.store.complete):
        views = {
            name: {
                "beyond_noise": None if math.isnan(value) else float(value),
                "status": status.get(name),
                "held_out": name in held_out,
                "excluded": name in excluded,
            }
            for name, value in zip(table.cameras, beyond[place], strict=True)
        }
        used = [
            one["beyond_noise"]
            for one in views.values()
            if one["beyond_noise"] is not None and not (one["held_out"] or one["excluded"])
        ]
        yield common | {"answer": _answer(used), "views": views}


def _answer(beyond: list[float]) -> dict[str, Any]:
    if not beyond:
        return {"verdict": UNKNOWN, "beyond_noise": None}
    return {
        "verdict": verdict_of_frame(max(beyond)),
        "beyond_noise": max(beyond),
        "beyond_noise_of_all": float(np.sqrt(np.mean(np.square(beyond)))),
    }
