"""What speaks for or against a volume, found in the figures of ``report.json``.

Each finder takes the figures and yields the values of a rule's words, one mapping for each time
that the rule applies. It adds no figure of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sized
from typing import Any

from rigs.check.resolved_wavelength import AS_LARGE
from tomo.hull.margins import CARVED_AWAY
from tomo.pipeline.answer import NOT_EXPLAINED, UNKNOWN_VERDICT
from tomo.uncertainty.intervals import NORMAL
from tomo.uncertainty.warnings import BARELY_SEEN, NOISY

Facts = Mapping[str, Any]

IN_DOUBT = ("hidden", "scatter", "dark", "order", "mirrored", "outside", "absorption")
"""Findings after which a volume is no better than amber: pixels or views are missing, or what was
corrected was not measured."""


GO_ON = "Go on with the corrected rig: refined_rig.yaml, or the corrected_rig of a film's store"
STAY = (
    "Do not go on with the corrected rig (refined_rig.yaml) yet: the images stay unexplained, and "
    "cameras are bent to whatever is wrong"
)
"""What to do with cameras that were refined from images that they then explain, or not."""


def _part(report: Facts, *keys: str) -> Any:
    """Return what stands at a path of keys; an empty mapping where nothing does."""
    for key in keys:
        report = report.get(key) or {}
    return report


def answers(verdict: str, report: Facts) -> Iterator[Facts]:
    """Yield what is unexplained, where the answer has this verdict."""
    answer = _part(report, "answer")
    if answer.get("verdict") == verdict:
        yield {
            "most": _percent(answer.get("beyond_noise") or 0),
            "all": _percent(answer.get("beyond_noise_of_all") or 0),
            "views": len(_used(report)),
        }


def wrong(kept: bool, report: Facts) -> Iterator[Facts]:
    """Yield what images say is wrong: what leaves the volume in doubt, or what was corrected."""
    for one in report.get("findings") or ():
        if (one["effect"] in IN_DOUBT or not one["corrected"]) == kept:
            reason, _, step = one["sentence"].partition(". ")
            yield {"reason": reason, "step": one["step"] or step}


def refined(report: Facts) -> Iterator[Facts]:
    """Yield how many cameras were refined from the images, if that was asked for."""
    found = _part(report, "refinement")
    if found.get("accepted") and found.get("asked", True):
        unexplained = _part(report, "answer").get("verdict") == NOT_EXPLAINED
        step = STAY if unexplained else GO_ON
        yield {"cameras": _count(found["cameras"]), "step": step}


def nominal(report: Facts) -> Iterator[Facts]:
    """Yield how many cameras nobody calibrated; where some were refined, that is said instead."""
    found = [name for name, view in _used(report).items() if view.get("status") == "nominal"]
    if found and not any(refined(report)):
        yield {"cameras": _count(found)}


def levels(key: str, report: Facts) -> Iterator[Facts]:
    """Yield the camera with the largest of the screening's levels, such as ``background``."""
    levels = _part(report, "screening", key)
    if levels:
        camera = _largest(levels)
        yield {"camera": camera, "level": levels[camera], "cameras": _count(levels)}


def carved(report: Facts) -> Iterator[Facts]:
    """Yield the light that no voxel was kept for, if it is much."""
    lost = _part(report, "carving").get("light_carved_away") or 0.0
    if lost > CARVED_AWAY:
        yield {"lost": f"{lost:.1%}"}


def unmeasured(low: float, high: float, report: Facts) -> Iterator[Facts]:
    """Yield the direction that views measure least, where that is within bounds."""
    found = _part(report, "uncertainty", "voxels", "resolved_wavelength")
    if found and low <= _or_infinite(found.get("of_length")) <= high:
        yield {"direction": least_measured(found)}


def least_measured(resolved: Facts) -> str:
    """Return the direction that views measure least, of a report's ``resolved_wavelength``."""
    words = resolved["worst_direction_in_words"]
    return f"(x, y, z) = {words}" if words.startswith("(") else words


def few(low: int, high: int, report: Facts) -> Iterator[Facts]:
    """Yield the number of views that took part, where it is within bounds."""
    views = len(_used(report))
    if low <= views <= high:
        yield {"cameras": _count(_used(report))}


def barely_seen(report: Facts) -> Iterator[Facts]:
    """Yield the fraction of the emitting voxels that no two views see, if it is large."""
    views = _part(report, "uncertainty", "voxels", "emitting_by_views")
    barely = sum(n for k, n in views.items() if int(k) < 2) / max(sum(views.values()), 1)
    if barely > BARELY_SEEN:
        yield {"share": f"{barely:.0%}"}


def uncertain(low: float, high: float, report: Facts) -> Iterator[Facts]:
    """Yield the error to expect of a voxel, where that is within bounds."""
    error, guess = expected_error(report), any(unmeasured(AS_LARGE, math.inf, report))
    if error is not None and low < error <= high and not guess:  # it misses what is a guess
        yield {"error": _percent(error)}


def expected_error(report: Facts) -> float | None:
    """Return the error to expect, root mean square over that of the emission; None: unknown.

    It is the 90 % interval's half-width over 1.645, as of a normal distribution.
    """
    half = _part(report, "uncertainty", "intervals", "voxels").get("relative")
    return None if half is None else half / NORMAL


def noisy(report: Facts) -> Iterator[Facts]:
    """Yield the voxels' standard deviation by noise, if it is large."""
    deviation = _part(report, "uncertainty", "standard_deviation").get("relative") or 0.0
    if deviation > NOISY:
        yield {"deviation": f"{deviation:.0%}"}


def not_predicted(low: float, high: float, report: Facts) -> Iterator[Facts]:
    """Yield the held-out camera that is predicted worst, where that is within bounds."""
    missed = {name: one["beyond_noise"] for name, one in _held_out(report).items()}
    camera = _largest(missed)
    if camera is not None and low < missed[camera] <= high:
        yield {"camera": camera, "missed": _percent(missed[camera])}


def unproved(report: Facts) -> Iterator[Facts]:
    """Yield where neither intervals nor a held-out camera say how far off voxels are."""
    known = _part(report, "answer").get("verdict") != UNKNOWN_VERDICT
    if known and expected_error(report) is None and not _held_out(report):
        yield {}


def error(report: Facts) -> Iterator[Facts]:
    """Yield the error to expect of a voxel, where it is known."""
    error = expected_error(report)
    if error is not None:
        yield {"error": _percent(error)}


def views(report: Facts) -> Iterator[Facts]:
    """Yield the median number of views of the voxels that emit."""
    if _part(report, "uncertainty", "voxels").get("median_views"):
        yield {"views": f"{report['uncertainty']['voxels']['median_views']:g}"}


def predicted(report: Facts) -> Iterator[Facts]:
    """Yield every held-out camera."""
    for name, one in _held_out(report).items():
        yield {"camera": name, "missed": _percent(one["beyond_noise"])}


def without_check(report: Facts) -> Iterator[Facts]:
    """Yield a camera that could be held out, where none was."""
    if not _held_out(report) and _used(report):
        yield {"camera": next(iter(_used(report)))}


def always(report: Facts) -> Iterator[Facts]:
    """Yield once."""
    yield {}


def _used(report: Facts) -> dict[str, Facts]:
    """Return the views that took part."""
    views = _part(report, "views").items()
    return {k: v for k, v in views if not (v.get("held_out") or v.get("excluded"))}


def _held_out(report: Facts) -> dict[str, Facts]:
    """Return the held-out views with light."""
    views = _part(report, "views").items()
    return {k: v for k, v in views if v.get("held_out") and v.get("beyond_noise") is not None}


def _largest(values: Mapping[str, float]) -> str | None:
    return max(values, key=values.__getitem__, default=None)


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None else value


def _count(cameras: Sized) -> str:
    return f"{len(cameras)} camera{'s' if len(cameras) != 1 else ''}"


def _percent(fraction: float) -> str:
    """Return a fraction in per cent, to two digits or a tenth."""
    return f"{fraction:.0%}" if fraction >= 0.0995 else f"{fraction:.1%}"
