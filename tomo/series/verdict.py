"""How far to trust a series: the verdict of every frame, the worst of them and how many."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

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
from tomo.series.answer import verdict_of_frame
from tomo.series.table import SeriesTable


def verdict_of_series(table: SeriesTable) -> dict[str, Any]:
    """Return the verdict of a series, as ``--json`` has it.

    Its ``level`` is that of the worst frame, ``frames`` counts those of each level. A reason that
    not all frames share says how many do, in the words of the frame that is explained least. The
    cameras, which are settled once, are in the verdict of every frame.

    Parameters
    ----------
    table : SeriesTable
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
