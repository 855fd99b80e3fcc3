"""A camera that stands out, in words and as plain numbers."""

from __future__ import annotations

from typing import Any

from tomo.screening.left_out_view import SIMPLER, Explained
from tomo.screening.remedies import ADVICE
from tomo.screening.single_camera import EXPLAINS, CameraFinding

ANOTHER = "out of step"


def likeliest(found: CameraFinding) -> list[Explained]:
    """Return a camera's two likeliest causes.

    Where none explains its image, another moment or another flame comes first.
    """
    causes = list(found.causes)
    if found.unexplained:
        causes.sort(key=lambda one: one.cause != ANOTHER)
    return causes[:2]


def causes_in_words(found: CameraFinding) -> str:
    """Return the sentence that names a camera and its two likeliest causes."""
    first, *rest = likeliest(found)
    words = "out of step, another moment or flame" if found.unexplained else first.words
    line = (
        f"camera {found.name}: its image differs by {found.error:.1%} from what the other cameras "
        f"predict, where {found.left_out:.1%} is usual: likeliest {words}"
    )
    if not rest:
        return line
    other = "swapped, another camera's image" if rest[0].cause == "swapped" else rest[0].words
    if not found.unexplained and _alike(first, rest[0]):
        return f"{line}, or {other}, which the images do not tell apart"
    return f"{line}; second likeliest {other}"


def advice_on(found: CameraFinding) -> str:
    """Return what to do about a camera, for each of its two likeliest causes."""
    named = likeliest(found)
    first = ADVICE[named[0].cause](found.name, named[0])
    if len(named) < 2 or (not found.unexplained and found.left(named[1]) > EXPLAINS):
        return first
    second = ADVICE[named[1].cause](found.name, named[1])
    return f"{first}. If that is not it: {second[0].lower()}{second[1:]}"


def report_of(found: CameraFinding) -> dict[str, Any]:
    """Return the entries of ``report.json`` of a camera."""
    return {
        "residual": found.error,
        "others": found.left_out,
        "ratio": found.error / found.left_out if found.left_out > 0 else None,
        "without": found.removed,
        "causes": [
            {
                "cause": one.cause,
                "words": one.words,
                "leaves": found.left(one),
                "parameters": dict(one.parameters),
                "needs": ADVICE[one.cause](found.name, one),
            }
            for one in likeliest(found)
        ],
    }


def _alike(first: Explained, second: Explained) -> bool:
    """Return whether the images do not tell two causes apart."""
    return max(first.excess, 0.0) > SIMPLER * max(second.excess, 0.0)
