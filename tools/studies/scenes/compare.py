"""What rows of scenes come to: by themselves, and against those of another tree.

Faultless scenes: the error over the other tree's, and what is said though nothing is wrong. Faults
that harm, by kind: those that let the error of the solve that corrects nothing grow 1.15 times
over that of the same scene without the fault. They are ``off`` where the default's error is 1.3
times that of the faultless scene; a fault that no correction can mend is not where it is met:
named, and the verdict not green, or the error within 1.05 of that without the cameras at fault.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from studies.common.study import Tables
from studies.scenes.faults import FAULTS
from studies.scenes.fields import CUT
from studies.scenes.findings import accused, is_alarm, named

Row = Mapping[str, Any]
Rows = Mapping[str, Row]

HARMS, OFF, AS_WELL = 1.15, 1.3, 1.05
"""Growth of the error from which a fault harms, from which it is off, and up to which a scene
comes out as well as another solve of it."""

WORSE = (1.10, 1.25)  # error over that of the other tree from which faultless scenes are counted


def tables_of(base: Rows, own: Rows | None = None) -> Tables:
    """Return tables of the scenes that both trees have; which faults harm, ``base`` says."""
    trees = {"base": base} if own is None else {"base": base, "own": own}
    shared = [key for key in base if all(key in tree for tree in trees.values())]
    plain = [key for key in shared if not base[key]["fault"]]
    harmful = [
        key for key in shared if _harm(base, key) >= HARMS and own_twin(base, key) in shared
    ]
    kinds: dict[str, list[str]] = {"all": harmful}
    kinds |= {f: [key for key in harmful if base[key]["fault"] == f] for f in FAULTS}
    return {
        "faultless": [_faultless(name, tree, base, plain) for name, tree in trees.items()],
        "faults": [
            {"fault": kind, "tree": name, "scenes": len(keys)} | _of_faults(tree, keys)
            for kind, keys in kinds.items()
            if keys
            for name, tree in trees.items()
        ],
        "alarms": [
            {"tree": name, "scene": tree[key]["scene"], "findings": _words(tree[key]["findings"])}
            for name, tree in trees.items()
            for key in plain
            if _alarm(tree[key])
        ],
        "scenes": [score(tree, key) | {"tree": name} for name, tree in trees.items()
                   for key in shared if _harm(base, key) > 0],
    }  # fmt: skip


def score(rows: Rows, key: str) -> dict[str, Any]:
    """Return what a scene with a fault came to, beside the same scene without it.

    ``harm`` and ``times``: the errors of the uncorrected solve and of the default over those of
    the faultless scene; ``of_uncorrected``: the default's over the uncorrected's.
    """
    row, twin = rows[key], rows[own_twin(rows, key)]
    error, bare = _number(row["nrmse"]), _number(row["uncorrected"])
    said = named(row["expected"], row["findings"])
    as_well = error <= AS_WELL * _number(row.get("without"), 0.0)
    met = not row["mendable"] and ((said and row["verdict"] != "green") or as_well)
    times = error / _number(twin["nrmse"])
    return {
        "scene": row["scene"],
        "fault": row["fault"],
        "harm": bare / _number(twin["uncorrected"]),
        "times": times,
        "of_uncorrected": error / bare,
        "off": times >= OFF and not met,
        "named": said,
        "accused": ", ".join(accused(row["expected"], row["findings"])),
        "verdict": row["verdict"],
        "green_and_off": times >= OFF and row["verdict"] == "green",
        "worse": error > AS_WELL * bare,
        "findings": _words(row["findings"]),
    }


def own_twin(rows: Rows, key: str) -> str:
    """Return the key of the same scene without its fault."""
    return str(rows[key]["faultless"])


def _harm(rows: Rows, key: str) -> float:
    """Return how a fault lets the uncorrected error grow; 0: not known, or there is no fault."""
    row, twin = rows[key], rows.get(own_twin(rows, key))
    if not row["fault"] or twin is None:
        return 0.0
    return _number(row["uncorrected"]) / _number(twin["uncorrected"])


def _faultless(name: str, tree: Rows, base: Rows, keys: Sequence[str]) -> dict[str, Any]:
    """Return the errors of faultless scenes over the base's, and what was said of them."""
    times = [_number(tree[key]["nrmse"]) / _number(base[key]["nrmse"]) for key in keys]
    found: dict[str, Any] = {"tree": name, "scenes": len(keys)}
    for column in ("nrmse", "cosine_distance", "cpu_seconds"):
        ratios = [_number(tree[k].get(column)) / _number(base[k].get(column)) for k in keys]
        found[column] = statistics.geometric_mean(ratios) if ratios else None
    found |= {f"above_{most}": sum(one > most for one in times) for most in WORSE}
    found["worst"] = max(times, default=None)
    found["alarms"] = sum(_alarm(tree[key]) for key in keys)
    return found | {
        level: sum(tree[key]["verdict"] == level for key in keys)
        for level in ("green", "amber", "red")
    }


def _of_faults(tree: Rows, keys: Sequence[str]) -> dict[str, Any]:
    """Return shares of the faults that harm."""
    scores = [score(tree, key) for key in keys]

    columns = ("off", "named", "accused", "green_and_off", "worse")
    found = {name: statistics.fmean(bool(one[name]) for one in scores) for name in columns}
    found["times"] = statistics.geometric_mean(min(one["times"], 100) for one in scores)
    return found | {"harm": statistics.geometric_mean(one["harm"] for one in scores)}


def _alarm(row: Row) -> bool:
    return is_alarm(row["findings"], ("outside",) if row["family"] in CUT else ())


def _words(findings: Sequence[Sequence[Any]]) -> str:
    return "; ".join(" ".join(filter(None, one)) for one in findings)


def _number(value: Any, otherwise: float = math.inf) -> float:
    """Return a number; infinity, or ``otherwise``, for what is not known: a run that failed."""
    return otherwise if value is None else float(value)
