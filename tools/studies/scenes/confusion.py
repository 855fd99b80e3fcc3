"""What the report says of scenes with a known fault, and of scenes without any.

``times`` is the NRMSE over that of the same scene without the fault. A fault that makes the error
grow 1.5 times or more is one that counts. A faultless scene in which a camera or a cause is named
is a false alarm; light from outside of flames that go on above the grid is none.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from studies.common.study import Progress, Tables
from studies.scenes.design import alarms, faulty
from studies.scenes.faults import FAULTS
from studies.scenes.fields import CUT
from studies.scenes.recipe import Recipe
from studies.scenes.trial import Row, Trials

COUNTS = 1.5
"""Growth of the error from which a fault has to be spoken of."""

NAMED_CAUSES = 2
"""Causes of an answer that are looked at: the likeliest."""

COLUMNS = {
    "overall": "faults count silent camera cause first_cause alarms faultless",
    "by_fault": "fault scenes times worst count silent camera cause others",
    "alarms": "scene cameras_named causes_named",
    "scenes": "",
}


def confusion(trials: Trials, half: str, *, quick: bool, progress: Progress) -> Tables:
    """Return what was said of faults: overall, by kind, of each scene, and the false alarms."""
    wrong = faulty(half, quick=quick)
    right = list(dict.fromkeys([r.faultless for r in wrong] + alarms(half, quick=quick)))
    rows = dict(zip([*right, *wrong], trials.run([*right, *wrong], progress), strict=True))
    judged = [_judged(rows[one], rows[one.faultless], one) for one in wrong]
    false = [rows[one] for one in right if _is_alarm(rows[one])]
    counting = [row for row in judged if row["times"] >= COUNTS]
    overall = {"faults": len(judged)} | _fractions(counting)
    overall |= {"alarms": len(false), "faultless": len(right)}
    return {
        "overall": [overall],
        "by_fault": [_of_kind(judged, fault) for fault in FAULTS],
        "alarms": [{k: _words(row[k]) for k in COLUMNS["alarms"].split()} for row in false],
        "scenes": judged,
    }


def _judged(row: Row, faultless: Row, recipe: Recipe) -> Row:
    fault = FAULTS[recipe.fault]
    wrong, cameras = set(row["at_fault"]), set(row["cameras_named"])
    causes = row["causes_named"][:NAMED_CAUSES]
    return row | {
        "times": row["nrmse"] / faultless["nrmse"],
        "camera": wrong <= cameras if fault.single else None,
        "others": bool(cameras - wrong) if fault.single else None,
        "cause": fault.cause in causes,
        "first_cause": fault.cause in causes[:1],
    }


def _is_alarm(row: Row) -> bool:
    expected = {"outside"} if row["family"] in CUT else set()
    return bool(set(row["causes_named"]) - expected or (row["cameras_named"] and not expected))


def _of_kind(rows: Sequence[Row], fault: str) -> Row:
    own = [row for row in rows if row["fault"] == fault]
    times = [row["times"] for row in own]
    return {
        "fault": fault,
        "scenes": len(own),
        "times": statistics.geometric_mean(times),
        "worst": max(times),
    } | _fractions(own, sum(t >= COUNTS for t in times))


def _fractions(rows: Sequence[Row], count: int | None = None) -> Row:
    """Return the fractions of rows in which something was said."""
    found: Row = {"count": len(rows) if count is None else count}
    for key in ("silent", "camera", "others", "cause", "first_cause"):
        values = [row[key] for row in rows if row[key] is not None]
        found[key] = statistics.fmean(values) if values else None
    return found


def _words(value: object) -> object:
    return ", ".join(value) if isinstance(value, list) else value
