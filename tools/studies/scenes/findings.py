"""What a report says is wrong: effects and cameras. The one place that reads reports."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
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
"""Words by which the name of an effect is known, where it is not a key."""

UNEXPLAINED = "unexplained"  # the effect of a finding that has none
FIRST = 2  # effects of a camera, or of all, that are looked at: the likeliest


class Finding(NamedTuple):
    """An effect, a key of `EFFECTS` where it is one, and the camera that has it, if it is one."""

    effect: str
    camera: str | None = None


def essence(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return as much of a ``report.json`` as this module reads."""
    return {key: report[key] for key in ("findings", "verdict") if key in report}


def findings_of(report: Mapping[str, Any]) -> list[Finding]:
    """Return what a ``report.json`` says is wrong, in its order."""
    listed = (Finding(_effect(o["effect"]), o.get("camera")) for o in report.get("findings", ()))
    return list(dict.fromkeys(listed))


def verdict_of(report: Mapping[str, Any]) -> str:
    """Return a report's verdict: green, amber or red."""
    verdict = report["verdict"]
    return str(verdict if isinstance(verdict, str) else verdict["level"])


def named(expected: Sequence[Sequence[Any]], findings: Sequence[Sequence[Any]]) -> bool:
    """Return whether a fault is named: each effect `KnownScene.expected`, with its camera.

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
    """Return whether anything is said but ``allowed`` and that images are not explained."""
    said = [(effect, camera) for effect, camera in findings if effect not in allowed]
    return any(effect != UNEXPLAINED or camera for effect, camera in said)


def _effect(name: str) -> str:
    """Return an effect's name as `EFFECTS` has it, or as it is."""
    name = name.lower().replace("_", " ")
    plain = name.replace(" ", "-")
    known = next((one for one in (name, plain) if one in EFFECTS), None)
    return known or next((one for one, w in EFFECTS.items() if re.search(w, name)), name)
