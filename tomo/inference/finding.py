"""What is wrong with a camera, an image or the gas, as a value: one table makes its words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

from tomo.scan.advice import FILE, WAYS, place_of


@dataclass(frozen=True)
class Finding:
    """One thing that images say is wrong.

    Attributes
    ----------
    effect : str
        A key of `WORDS`.
    camera : str, optional
        The camera that has it; None where all share it.
    size : float
        In ``unit``; for pixels left out their fraction.
    error : float, optional
        What exact cameras make of the same size, one standard deviation, in ``unit``.
    unit : str
        ``%`` stands for fractions.
    score : float
        How far the size exceeds what exact cameras make: 1 is the limit.
    corrected : bool
        Whether the volume was made without it.
    consequence : float, optional
        What the effect changes of the camera's image, relative to it, root mean square.
    other : str, optional
        Another camera that is concerned, how an image is turned, or where gas is.
    line : str, optional
        What corrects it, of all cameras with this effect, in the ``way`` of the scan.
    way : str
        How corrections are given to the scan, one of `tomo.scan.advice.WAYS`.
    """

    effect: str
    camera: str | None = None
    size: float = 0.0
    error: float | None = None
    unit: str = ""
    score: float = 1.0
    corrected: bool = True
    consequence: float | None = None
    other: str | None = None
    line: str | None = None
    way: str = FILE

    @classmethod
    def of(cls, report: Mapping[str, Any]) -> Finding:
        """Return the finding that `report` made plain values of."""
        return cls(**{one.name: report[one.name] for one in fields(cls) if one.name in report})

    @property
    def step(self) -> str:
        """What to do."""
        places = {
            name: place_of(self.way, name) for name in ("dark", "flat", "mask", "saturation")
        }
        step = WORDS[self.effect][1].format(camera=self.camera, other=self.other, **places)
        return step if self.line is None else f"{step}, or {WAYS[self.way].ask.format(self.line)}"

    @property
    def leaves_doubt(self) -> bool:
        """Whether a volume may be wrong by it all the same."""
        return not self.corrected or self.effect in IN_DOUBT

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        (said,) = together([self])
        return {**asdict(self), "sentence": said.sentence, "step": self.step}


class Said(NamedTuple):
    """Findings in words: what was found and done, and what to do."""

    text: str
    step: str

    @property
    def sentence(self) -> str:
        """All of it."""
        return f"{self.text}. {self.step}"


def together(findings: Iterable[Finding]) -> list[Said]:
    """Return findings in words, in their order; cameras with the same fault share a sentence."""
    groups: dict[tuple, list[Finding]] = {}
    for one in findings:
        alone = one.other if one.other is not None else one.camera is None
        groups.setdefault((one.effect, one.corrected, alone), []).append(one)
    return [_in_words(group) for group in groups.values()]


def _in_words(group: list[Finding]) -> Said:
    most = max(group, key=lambda one: abs(one.size))
    who, size = "all cameras" if most.camera is None else f"camera {most.camera}", _size(most)
    if len(group) > 1:
        who, size = f"{len(group)} cameras, {most.camera} most", f"up to {size}"
        if len(group) <= MOST_NAMED:
            who = f"cameras {', '.join(str(one.camera) for one in group)}"
    done = "left out" if most.effect in LEFT_OUT else "corrected"
    text = WORDS[most.effect][0].format(who=who, size=size, other=most.other or "in the grid")
    text += f": {done if most.corrected else f'not {done}'}"
    return Said(text, most.step)


def _size(one: Finding) -> str:
    """Return size, error and unit as text."""
    factor = 100 if one.unit == "%" else 1
    size = f"{factor * one.size:.1f}" if one.unit else f"{one.size:.2g}"
    error = "" if one.error is None else f" ± {factor * one.error:.1g}"
    return f"{size}{error} {one.unit}".rstrip()


MOST_NAMED = 4
"""Cameras of a line that are named; of more the worst is, and report.json has all."""

LEFT_OUT = (
    "hidden", "scatter", "disagreement", "saturation", "bad pixels", "dark", "same image",
)  # fmt: skip
"""Effects that are not corrected but left out."""

IN_DOUBT = (
    "hidden", "scatter", "disagreement", "saturation", "dark", "same image", "outside",
    "absorption",
)  # fmt: skip
"""Effects after which a volume is in doubt though it was made without them: pixels or views are
missing, or what was corrected was not measured."""

_LOOK = "Look at the image beside its re-projection, and mask what is no flame ({mask})"

WORDS: Mapping[str, tuple[str, str]] = {
    "gain": ("{who}: gain {size} off what the others say", "Check exposure and aperture"),
    "background": (
        "{who}: a background of {size} of the brightest light",
        "Check the dark frames ({dark})",
    ),
    "below zero": (
        "{who}: dark regions {size} of the brightest light below zero, too much was subtracted "
        "as dark and the volume is too faint",
        "Check the dark frames, or lower the dark level ({dark})",
    ),
    "pose": (
        "{who}: pose off, pointing {size} beside where the rig says",
        "Calibrate again, or run with --refine-cameras",
    ),
    "magnification": (
        "{who}: images magnified by {size} more than the rig says",
        "Check focal length and focus, and calibrate again",
    ),
    "blur": (
        "{who}: images blurred by {size} (standard deviation), out of focus or in motion",
        "Check the focus, and expose shorter",
    ),
    "fall-off": (
        "{who}: images darken towards their corners, by {size} there (vignetting)",
        "Take a flat field and name it ({flat})",
    ),
    "absorption": (
        "gas {other} absorbs: optical depth {size}",
        "If the gas is transparent, reconstruct with --no-fit-absorption; else measure it",
    ),
    "outside": (
        "the grid cuts the flame, {size} of the light comes from outside it",
        "Enlarge the grid (--lower and --upper, or --grid), or mask or subtract that light",
    ),
    "hidden": (
        "{who}: {size} of the pixels are darker than the others say, something hides the flame",
        _LOOK,
    ),
    "scatter": (
        "{who}: {size} of the pixels are brighter than any volume explains, light is reflected "
        "or scattered, or the flame is that of another moment",
        _LOOK,
    ),
    "disagreement": (
        "{who}: no correction makes the image agree with those of the others: light is reflected "
        "or scattered, the flame is that of another moment, or the camera is not where the rig "
        "says",
        "Look at the image beside its re-projection, and check camera {camera}",
    ),
    "saturation": (
        "{who}: images cut off at {size}, saturation: more pixels have that value than lie just "
        "below it",
        "Expose shorter, or give the level ({saturation})",
    ),
    "bad pixels": (
        "{who}: {size} of the pixels are outliers",
        "Mask what is not single pixels ({mask})",
    ),
    "dark": ("{who}: no light, a cap, a closed shutter, or a wrong file", "Check camera {camera}"),
    "same image": (
        "{who}: its image is that of camera {other} too",
        "Check the files of cameras {camera} and {other}",
    ),
    "order": (
        "{who}: its image is that of camera {other}",
        "Check the order of the files of cameras {camera} and {other}",
    ),
    "mirrored": (
        "{who}: its image is turned over ({other})",
        "Check the orientation of camera {camera}'s images",
    ),
}
"""By effect: what was found, and what to do. Fields: ``who``, ``size``, ``camera``,
``other``, and the corrections, for where they are given."""
