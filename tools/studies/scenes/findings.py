"""What a report says is wrong: effects and cameras, whichever form the report has.

The one place that reads reports. A report with ``findings`` is read there: objects with ``effect``
and ``camera``. An older one is read in the words of its warnings and of its answer.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

EFFECTS: Mapping[str, str] = {
    "gain": r"\bgain",
    "background": r"background|dark|below zero|\boffset",
    "pose": r"\bpose\b|\bpointing|\bpoint elsewhere|\bshift|pixels (off|beside)|disagree|refine"
    r"|calibrat|\broll",
    "magnification": r"magnif|focal|zoom",
    "order": r"swapped|exchanged|looks like camera|each other's|same (image|file)",
    "mirrored": r"mirrored|upside down|turned by",
    "hidden": r"hidden|obstruct|covered|opaque|occlu",
    "saturation": r"saturat|full scale|overexposed",
    "outside": r"outside",
    "absorption": r"absor|\bmedium",
    "fall-off": r"vignett|fall-?off",
    "blur": r"blur|focus|\bmotion",
    "out of step": r"out of step|another moment",
    "disagreement": r"no correction makes",
    "gamma": r"gamma|non-?linear|not linear|\bresponse",
    "scatter": r"scatter|\bveil|ghost|\breflection|stray",
    "bad pixels": r"outlier|bad pixel|\bhot\b|\bdead\b|column",
    "dark": r"\bcap\b|no light",
}
"""Words by which an effect is named in the first sentence of a warning, or as an effect."""

UNEXPLAINED = "unexplained"
"""The effect of a finding that has none."""

_UNEXPLAINED = r"unexplained|not explained"
_SENTENCE = r"\. (?=[A-Z])"
_ADVICE = "no cause that was tested"
EXPLAINED = "explained"

FIRST = 2
"""Effects of a camera, or of all, that are looked at: the likeliest."""


class Finding(NamedTuple):
    """An effect, a key of `EFFECTS` where it is one, and the camera that has it, if it is one."""

    effect: str
    camera: str | None = None


def essence(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return as much of a ``report.json`` as this module reads."""
    kept = {key: report[key] for key in ("findings", "warnings") if key in report}
    answer = {key: (report.get("answer") or {}).get(key) for key in ("verdict", "sentence")}
    return kept | {"answer": answer, "views": list(report.get("views", ()))}


def findings_of(report: Mapping[str, Any]) -> list[Finding]:
    """Return what a ``report.json`` says is wrong, in its order."""
    if "findings" in report:
        listed = [Finding(_effect(one["effect"]), one.get("camera")) for one in report["findings"]]
        return list(dict.fromkeys(listed))
    lines = [re.split(_SENTENCE, line)[0] for line in report.get("warnings", ())]
    answer = report.get("answer") or {}
    if answer.get("verdict") not in (None, EXPLAINED):
        lines += answer["sentence"].split(_ADVICE)[0].split(";")
    names = list(report.get("views", ()))
    return list(dict.fromkeys(one for line in lines for one in _said(line, names)))


def verdict_of(report: Mapping[str, Any]) -> str:
    """Return a report's verdict: green, amber or red."""
    verdict = report["verdict"]
    return str(verdict if isinstance(verdict, str) else verdict["level"])


def named(expected: Sequence[Sequence[Any]], findings: Sequence[Sequence[Any]]) -> bool:
    """Return whether a fault is named: each of its effects, with its camera.

    Parameters
    ----------
    expected : sequence of (sequence of str, str or None)
        See `studies.scenes.scene.KnownScene.expected`.
    findings : sequence of (effect, camera)
        The first two effects of a camera count; of all, where no camera is asked for.
    """
    for names, camera in expected:
        own = (effect for effect, whose in findings if camera in (whose, None))
        likeliest = [effect for effect in dict.fromkeys(own) if effect != UNEXPLAINED][:FIRST]
        if not set(names) & set(likeliest):
            return False
    return bool(expected)


def accused(expected: Sequence[Sequence[Any]], findings: Sequence[Sequence[Any]]) -> list[str]:
    """Return the cameras that findings name and that have no fault; none where all have it."""
    wrong = {camera for _, camera in expected}
    others = (camera for _, camera in findings if camera is not None)
    return [] if None in wrong else [one for one in dict.fromkeys(others) if one not in wrong]


def is_alarm(findings: Sequence[Sequence[Any]], allowed: Sequence[str] = ()) -> bool:
    """Return whether anything is said of a faultless scene but ``allowed`` effects.

    That its images are not explained is no alarm, unless a camera is named.
    """
    said = [(effect, camera) for effect, camera in findings if effect not in allowed]
    return any(effect != UNEXPLAINED or camera for effect, camera in said)


def _effect(name: str) -> str:
    """Return an effect's name as `EFFECTS` has it, or as it is."""
    name = name.lower().replace("_", " ")
    plain = name.replace(" ", "-")
    known = next((one for one in (name, plain) if one in EFFECTS), None)
    return known or next((one for one, w in EFFECTS.items() if re.search(w, name)), name)


def _said(line: str, names: Sequence[str]) -> Iterator[Finding]:
    """Yield what one line of an older report says: its effects, in order, of all its cameras."""
    matches = {effect: re.search(words, line) for effect, words in EFFECTS.items()}
    places = {effect: match.start() for effect, match in matches.items() if match}
    effects = sorted(places, key=places.__getitem__)
    cameras = [name for name in names if re.search(rf"\b{re.escape(name)}\b", line)]
    if not effects and (cameras or re.search(_UNEXPLAINED, line.lower())):
        effects = [UNEXPLAINED]
    for effect in effects:
        yield from (Finding(effect, camera) for camera in cameras or (None,))
