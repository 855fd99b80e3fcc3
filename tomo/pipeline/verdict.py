"""The verdict of a volume, by rules: one row a finding, with its level, words and next step."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from rigs.check.resolved_wavelength import AS_LARGE
from tomo.pipeline import facts
from tomo.pipeline.answer import HARMFUL
from tomo.pipeline.facts import LARGE, Facts

GREEN, AMBER, RED = LEVELS = ("green", "amber", "red")
MEANS: Mapping[str, str] = {GREEN: "use it", AMBER: "use with care", RED: "do not use"}


@dataclass(frozen=True)
class Verdict:
    """How far a volume can be trusted."""

    level: str  # one of LEVELS
    reasons: tuple[str, ...] = ()  # the gravest first; of green, what speaks for it
    next: tuple[str, ...] = ()  # what to do, the most useful first

    @property
    def sentence(self) -> str:
        """The level and its first reason in one sentence."""
        more = len(self.reasons) - 1
        rest = f", and {more} more reason{'s' if more > 1 else ''}" if more > 0 else ""
        if self.level == GREEN:
            rest = ""
        begin = f"{self.level.capitalize()}, {MEANS[self.level]}"
        return f"{begin}: {self.reasons[0]}{rest}." if self.reasons else f"{begin}."

    def report(self) -> dict[str, Any]:
        """Return ``report.json``'s ``verdict``."""
        return {
            "level": self.level,
            "sentence": self.sentence,
            "reasons": list(self.reasons),
            "next": list(self.next),
        }


Finder = Callable[[Facts], Iterator[Facts]]
"""From ``report.json`` to the values of a rule's words, one mapping for each time it applies."""

MANY = math.inf

FEWEST_VIEWS = 5
"""Views from which a wrong one can be found: four may agree with each other on a wrong volume."""

TWO_VIEWS = 1.4
"""Wavelength that views leave unmeasured, relative to the emission's extent, from which they are
no more than two at right angles, which reach 1.41. Three evenly spread views reach 1.0."""


MISSED = 0.7, 1.0
"""The part of an image that is neither volume nor noise, over the error that exact cameras would
leave in the volume, from which the volume is amber and red. Lower: voxels that are coarse for the
flame; higher: volumes 1.3 and 1.5 times as wrong as with exact cameras."""


@dataclass(frozen=True)
class Rule:
    """One finding: when it applies, its level, and words that ``find`` fills, if there are any."""

    level: str
    find: Finder = field(repr=False)
    reason: str
    step: str = ""


def judge(report: Facts) -> Verdict:
    """Return how far the volume of a ``report.json`` can be trusted."""
    found = rules_that_apply(report)
    if not found:
        for_it = [(rule, values) for rule in FOR_IT for values in rule.find(report)]
        return Verdict(GREEN, _reasons(for_it), _steps(for_it))
    graver = sorted(found, key=lambda one: -LEVELS.index(one[0].level))
    return Verdict(graver[0][0].level, _reasons(graver), _steps(found))


def rules_that_apply(report: Facts) -> list[tuple[Rule, Facts]]:
    """Return the rules that speak against the volume of a ``report.json``, with their values."""
    return [(rule, values) for rule in RULES for values in rule.find(report)]


def _reasons(found: list[tuple[Rule, Facts]]) -> tuple[str, ...]:
    return _unlike(rule.reason.format(**values) for rule, values in found)


def _steps(found: list[tuple[Rule, Facts]]) -> tuple[str, ...]:
    return _unlike(rule.step.format(**values) for rule, values in found)


def _unlike(lines: Iterable[str]) -> tuple[str, ...]:
    """Return lines in their order, each once and none that is empty."""
    return tuple(dict.fromkeys(filter(None, lines)))


def worst_of(verdicts: Sequence[Verdict]) -> str:
    """Return the gravest level of some verdicts; green of none."""
    return max((one.level for one in verdicts), key=LEVELS.index, default=GREEN)


_CHECK = (
    "Try smaller voxels (--spacing), and check that the flame did not move between the cameras' "
    "exposures"
)

RULES: tuple[Rule, ...] = (
    Rule(RED, facts.unknown,
         "no image has light to compare the volume with",
         "Check the exposure, the dark level, and that the images belong to these cameras"),
    Rule(AMBER, partial(facts.wrong, True), "{reason}", "{step}"),
    Rule(AMBER, facts.carved,
         "{lost} of the light meets no voxel that was kept",
         "Keep all voxels (--no-skip)"),
    Rule(RED, partial(facts.missed, MISSED[1], MANY),
         "the volume is expected to be wrong by more than the {error} that exact cameras would "
         "leave: up to {missed} of an image is neither volume nor noise",
         _CHECK),
    Rule(AMBER, partial(facts.missed, *MISSED),
         "up to {missed} of an image is neither volume nor noise, where exact cameras would leave "
         "an error of {error} in the volume",
         _CHECK),
    Rule(RED, partial(facts.not_predicted, more_than_stated=True),
         "the held-out camera {camera} is not predicted: {missed} of its image is wrong beyond "
         "noise, more than the {stated} to expect",
         "Check camera {camera}, and add cameras between the others"),
    Rule(AMBER, partial(facts.not_predicted, more_than_stated=False),
         "the held-out camera {camera} is predicted in part: {missed} of its image is wrong "
         "beyond noise",
         "Add cameras, or check the calibration of camera {camera}"),
    Rule(RED, partial(facts.few, 1, 2),
         "too few for a volume: {cameras}. Many shapes have the same images",
         "Add cameras: four evenly spread ones are the least"),
    Rule(RED, partial(facts.unmeasured, TWO_VIEWS, MANY),
         "cameras from these directions are too few for a volume: nothing fixes its shape along "
         "{direction}",
         "Add cameras that look across {direction}: four evenly spread ones are the least"),
    Rule(AMBER, partial(facts.unmeasured, AS_LARGE, TWO_VIEWS),
         "few directions: the shape along {direction} is a guess, its error is not known",
         "Add a camera that looks across {direction}, or move one there"),
    Rule(RED, partial(facts.uncertain, LARGE, MANY),
         "the error to expect of a voxel is {error} of the emission",
         "Add cameras, or average over frames"),
    Rule(AMBER, partial(facts.uncertain, HARMFUL, LARGE),
         "the error to expect of a voxel is {error} of the emission; "
         f"up to {HARMFUL:.0%} is good",
         "Trust sums and means over regions more than single voxels; more cameras narrow this"),
    Rule(AMBER, facts.barely_seen,
         "fewer than two cameras see {share} of the voxels that emit",
         "Do not use those voxels, or move the grid to where the cameras look"),
    Rule(AMBER, partial(facts.few, 3, FEWEST_VIEWS - 1),
         f"with {{cameras}} a wrong one cannot be found: that takes {FEWEST_VIEWS}",
         "Add cameras, or check the calibration with check-rig and a calibration target"),
    Rule(AMBER, facts.refined,
         "the positions of {cameras} were corrected from the images",
         "Go on with the corrected rig (refined_rig.yaml, corrected_rig of a film's store) if it "
         "explains the images: else cameras are bent to whatever is wrong"),
    Rule(AMBER, facts.nominal,
         "the positions of {cameras} are nominal, not calibrated: images that agree do not prove "
         "them",
         "Calibrate them (calibrate-rig); where they were, say status: calibrated in the rig"),
    Rule(AMBER, facts.unproved,
         "how far off voxels are was not measured",
         "Reconstruct single frames (--uncertainty auto), or hold a camera out (--hold-out NAME)"),
)  # fmt: skip
"""What keeps a volume from being green. Their order is that of the steps: mend first what makes
other things seem wrong."""

FOR_IT: tuple[Rule, ...] = (
    Rule(GREEN, facts.explained,
         "the volume explains the images of all {views} cameras {rest}"),
    Rule(GREEN, partial(facts.wrong, False), "{reason}", "{step}"),
    Rule(GREEN, facts.error, "the error to expect of a voxel is {error} of the emission"),
    Rule(GREEN, facts.predicted,
         "camera {camera}, which was held out, is predicted: {missed} of its image is wrong "
         "beyond noise"),
    Rule(GREEN, facts.without_check,
         "",
         "Check it once with an image that it never saw: run again with --hold-out {camera}"),
    Rule(GREEN, facts.always,
         "",
         "Use volume.vti (ParaView), volume.nrrd (3D Slicer) or volume.npz (Python), with "
         "half_width.* as error bars"),
)  # fmt: skip
"""What is said of a green volume."""
