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
from tomo.inference.finding import Finding, together
from tomo.pipeline.answer import EXPLAINED, HARMFUL, UNKNOWN_VERDICT, percent
from tomo.uncertainty.intervals import NORMAL

Facts = Mapping[str, Any]

BARELY_SEEN = 0.05
"""Largest fraction of the emitting voxels that fewer than two views may see."""


def _part(report: Facts, *keys: str) -> Any:
    """Return what stands at a path of keys; an empty mapping where nothing does."""
    for key in keys:
        report = report.get(key) or {}
    return report


def unknown(report: Facts) -> Iterator[Facts]:
    """Yield where no image has light."""
    if _part(report, "answer").get("verdict") == UNKNOWN_VERDICT:
        yield {}


def explained(report: Facts) -> Iterator[Facts]:
    """Yield how far the images are explained."""
    answer = _part(report, "answer")
    rest = "up to their noise"
    if answer.get("verdict") != EXPLAINED and answer.get("beyond_noise"):
        rest = f"but for {percent(answer['beyond_noise'])} of an image"
    yield {"views": len(_used(report)), "rest": rest}


def wrong(in_doubt: bool, report: Facts) -> Iterator[Facts]:
    """Yield what images say is wrong: what leaves the volume in doubt, or what was corrected."""
    apart = _held_out(report)  # nothing about these leaves the volume in doubt
    found = map(Finding.of, report.get("findings") or ())
    own = (f for f in found if (f.leaves_doubt and f.camera not in apart) == in_doubt)
    for said in together(own):
        yield {"reason": said.text, "step": said.step}


def missed(low: float, high: float, report: Facts) -> Iterator[Facts]:
    """Yield what nothing explains of an image, if its ratio to a stated error is in bounds."""
    error = stated_error(report)
    most = _part(report, "answer").get("beyond_noise") or 0.0
    if error and low * error < most <= high * error:
        yield {"missed": percent(most), "error": percent(error)}


def refined(report: Facts) -> Iterator[Facts]:
    """Yield how many cameras were refined from the images, if that was asked for."""
    found = _part(report, "refinement")
    if found.get("accepted") and found.get("asked", True):
        yield {"cameras": _count(found["cameras"])}


def nominal(report: Facts) -> Iterator[Facts]:
    """Yield how many cameras nobody calibrated; where some were refined, that is said instead."""
    found = [name for name, view in _used(report).items() if view.get("status") == "nominal"]
    if found and not any(refined(report)):
        yield {"cameras": _count(found)}


def carved(report: Facts) -> Iterator[Facts]:
    """Yield the light that no voxel was kept for, if it is much."""
    lost = _part(report, "carving").get("light_carved_away") or 0.0
    if lost > CARVED_AWAY:
        yield {"lost": f"{lost:.1%}"}


def unmeasured(low: float, high: float, report: Facts) -> Iterator[Facts]:
    """Yield the direction that views measure least, where that is within bounds."""
    found = _part(report, "uncertainty", "voxels", "resolved_wavelength")
    if found:
        length = found.get("of_length")
        if low <= (math.inf if length is None else length) <= high:
            yield {"direction": least_measured(found)}


def least_measured(resolved: Facts) -> str:
    """Return the direction that views measure least, of a report's ``resolved_wavelength``."""
    words = resolved["worst_direction_in_words"]
    return f"(x, y, z) = {words}" if words.startswith("(") else words


def few(low: int, high: int, report: Facts) -> Iterator[Facts]:
    """Yield the number of views that took part, where it is within bounds."""
    if low <= len(_used(report)) <= high:
        yield {"cameras": _count(_used(report))}


def barely_seen(report: Facts) -> Iterator[Facts]:
    """Yield the fraction of the emitting voxels that no two views see, if it is large."""
    views = _part(report, "uncertainty", "voxels", "emitting_by_views")
    barely = sum(n for k, n in views.items() if int(k) < 2) / max(sum(views.values()), 1)
    if barely > BARELY_SEEN:
        yield {"share": f"{barely:.0%}"}


def uncertain(low: float, high: float, report: Facts) -> Iterator[Facts]:
    """Yield the error to expect of a voxel, where that is within bounds."""
    error, begin = expected_error(report), ""
    if error is None:
        # no less than what an image misses
        error, begin = _part(report, "answer").get("beyond_noise") or 0.0, "at least "
    elif any(unmeasured(AS_LARGE, math.inf, report)):  # it misses what is a guess
        return
    if low < error <= high:
        yield {"error": f"{begin}{percent(error)}"}


def expected_error(report: Facts) -> float | None:
    """Return a voxel's relative error: the 90 % interval's half-width over 1.645 (normal)."""
    half = _part(report, "uncertainty", "intervals", "voxels").get("relative")
    return None if half is None else half / NORMAL


def stated_error(report: Facts) -> float | None:
    """Return the error that exact cameras would leave: without what the images add to it."""
    error = expected_error(report)
    growth = _part(report, "uncertainty", "intervals", "voxels").get("growth") or 1.0
    return None if error is None else error / growth


def not_predicted(report: Facts, *, more_than_stated: bool) -> Iterator[Facts]:
    """Yield the held-out camera predicted worst, if badly: by more than stated, or less."""
    # gain and background are fitted: what is wrong with these is no fault of the volume
    found = {name: one["fitted"] for name, one in _held_out(report).items()}
    camera = max(found, key=found.__getitem__, default=None)
    if camera is not None and found[camera] > HARMFUL:
        stated = max(expected_error(report) or LARGE, HARMFUL)
        if (found[camera] > stated) == more_than_stated:
            yield {"camera": camera, "missed": percent(found[camera]), "stated": percent(stated)}


LARGE = 0.5
"""Error of voxels, relative to the emission, from which a volume is of no use."""


def unproved(report: Facts) -> Iterator[Facts]:
    """Yield where neither intervals nor a held-out camera say how far off voxels are."""
    if not any(unknown(report)) and expected_error(report) is None and not _held_out(report):
        yield {}


def error(report: Facts) -> Iterator[Facts]:
    """Yield the error to expect of a voxel, where it is known."""
    error = expected_error(report)
    if error is not None:
        yield {"error": percent(error)}


def predicted(report: Facts) -> Iterator[Facts]:
    """Yield every held-out camera."""
    for name, one in _held_out(report).items():
        yield {"camera": name, "missed": percent(one["fitted"])}


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


def _held_out(report: Facts) -> dict[str, dict[str, float]]:
    """Return what is wrong with the prediction of held-out views with light, beyond noise."""
    found = {}
    for name, view in _part(report, "views").items():
        if view.get("held_out") and view.get("beyond_noise") is not None:
            fitted = _part(report, "held_out", name, "fitted").get("beyond_noise")
            given = view["beyond_noise"]
            found[name] = {"given": given, "fitted": given if fitted is None else fitted}
    return found


def _count(cameras: Sized) -> str:
    return f"{len(cameras)} camera{'s' if len(cameras) != 1 else ''}"
