"""The rules of the verdict: one row a finding, with its level, its words and the next step."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

from rigs.check.resolved_wavelength import AS_LARGE
from tomo.pipeline.answer import EXPLAINED, HARMFUL, NOT_EXPLAINED, PARTLY, UNKNOWN_VERDICT
from tomo.pipeline.verdict import findings
from tomo.pipeline.verdict.findings import Facts
from tomo.pipeline.verdict.value import AMBER, GREEN, LEVELS, RED, Verdict
from tomo.uncertainty.warnings import NOISY, UNEXPLAINED

Finder = Callable[[Facts], Iterator[Facts]]
"""From ``report.json`` to the values of a rule's words, one mapping for each time it applies."""

MANY = math.inf

FEWEST_VIEWS = 5
"""Views from which a wrong one can be found: four may agree with each other on a wrong volume."""

TWO_VIEWS = 1.4
"""Wavelength that views leave unmeasured, relative to the emission's extent, from which they are
no more than two at right angles, which reach 1.41. Three evenly spread views reach 1.0."""


@dataclass(frozen=True)
class Rule:
    """One finding: when it applies, what it makes of the volume, and in which words.

    Attributes
    ----------
    level : str
    find : callable
        See `Finder`.
    reason, step : str
        With fields that ``find`` fills; nothing is said where one is empty.
    """

    level: str
    find: Finder = field(repr=False)
    reason: str
    step: str = ""


def judge(report: Facts) -> Verdict:
    """Return how far the volume of a ``report.json`` can be trusted.

    Examples
    --------
    >>> judge({"answer": {"verdict": "not known"}}).level
    'red'
    """
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


RULES: tuple[Rule, ...] = (
    Rule(RED, partial(findings.answers, UNKNOWN_VERDICT),
         "no image has light to compare the volume with",
         "Check the exposure, the dark level, and that the images belong to these cameras"),
    Rule(AMBER, partial(findings.wrong, True), "{reason}", "{step}"),
    Rule(AMBER, partial(findings.levels, "background"),
         "light everywhere in the images of {cameras}, {camera} most ({level:.3g})",
         "Subtract the background: the warning on the dark level has the line for scan.yaml"),
    Rule(AMBER, partial(findings.levels, "below_zero"),
         "too much was subtracted as dark in {cameras}, {camera} most ({level:.3g})",
         "Check the dark frames, or lower the dark level in scan.yaml (corrections: dark)"),
    Rule(AMBER, partial(findings.levels, "saturated"),
         "overexposed: {cameras}, whose brightest pixels were left out",
         "Expose camera {camera} shorter"),
    Rule(AMBER, findings.carved,
         "{lost} of the light meets no voxel that was kept",
         "Keep all voxels (--no-skip)"),
    Rule(RED, partial(findings.answers, NOT_EXPLAINED),
         "the volume does not explain its images: up to {most} of an image is neither volume nor "
         "noise",
         "Try smaller voxels (--spacing), and check that the flame did not move between the "
         "cameras' exposures"),
    Rule(AMBER, partial(findings.answers, PARTLY),
         "the volume explains its images in part: up to {most} of an image is neither volume nor "
         "noise",
         "Try smaller voxels (--spacing), and check that the flame did not move between the "
         "cameras' exposures"),
    Rule(RED, partial(findings.not_predicted, UNEXPLAINED, MANY),
         "the held-out camera {camera} is not predicted: {missed} of its image is wrong "
         "beyond noise",
         "Check camera {camera}, and add cameras between the others"),
    Rule(AMBER, partial(findings.not_predicted, HARMFUL, UNEXPLAINED),
         "the held-out camera {camera} is predicted in part: {missed} of its image is wrong "
         "beyond noise",
         "Add cameras, or check the calibration of camera {camera}"),
    Rule(RED, partial(findings.few, 1, 2),
         "too few for a volume: {cameras}. Many shapes have the same images",
         "Add cameras: four evenly spread ones are the least"),
    Rule(RED, partial(findings.unmeasured, TWO_VIEWS, MANY),
         "cameras from these directions are too few for a volume: nothing fixes its shape along "
         "{direction}",
         "Add cameras that look across {direction}: four evenly spread ones are the least"),
    Rule(AMBER, partial(findings.unmeasured, AS_LARGE, TWO_VIEWS),
         "few directions: the shape along {direction} is a guess, its error is not known",
         "Add a camera that looks across {direction}, or move one there"),
    Rule(RED, partial(findings.uncertain, NOISY, MANY),
         "the error to expect of a voxel is {error} of the emission",
         "Add cameras, or average over frames"),
    Rule(AMBER, partial(findings.uncertain, HARMFUL, NOISY),
         "the error to expect of a voxel is {error} of the emission; "
         f"up to {HARMFUL:.0%} is good",
         "Trust sums and means over regions more than single voxels; more cameras narrow this"),
    Rule(RED, findings.noisy,
         "noise hides the volume: it moves voxels by {deviation} of the emission",
         "Average over frames or regions, expose longer, or use fewer voxels"),
    Rule(AMBER, findings.barely_seen,
         "fewer than two cameras see {share} of the voxels that emit",
         "Do not use those voxels, or move the grid to where the cameras look"),
    Rule(AMBER, partial(findings.few, 3, FEWEST_VIEWS - 1),
         f"with {{cameras}} a wrong one cannot be found: that takes {FEWEST_VIEWS}",
         "Add cameras, or check the calibration with check-rig and a calibration target"),
    Rule(AMBER, findings.refined,
         "the positions of {cameras} were corrected from the images",
         "{step}"),
    Rule(AMBER, findings.nominal,
         "the positions of {cameras} are nominal, not calibrated: images that agree do not prove "
         "them",
         "Calibrate them (calibrate-rig); where they were, say status: calibrated in the rig"),
    Rule(AMBER, findings.unproved,
         "how far off voxels are was not measured",
         "Reconstruct single frames (--uncertainty auto), or hold a camera out (--hold-out NAME)"),
)  # fmt: skip
"""What keeps a volume from being green. Their order is that of the steps: mend first what makes
other things seem wrong."""

FOR_IT: tuple[Rule, ...] = (
    Rule(GREEN, partial(findings.answers, EXPLAINED),
         "the volume explains the images of all {views} cameras up to their noise"),
    Rule(GREEN, partial(findings.wrong, False), "{reason}", "{step}"),
    Rule(GREEN, findings.views, "about {views} cameras see each voxel that emits"),
    Rule(GREEN, findings.error, "the error to expect of a voxel is {error} of the emission"),
    Rule(GREEN, findings.predicted,
         "camera {camera}, which was held out, is predicted: {missed} of its image is wrong "
         "beyond noise"),
    Rule(GREEN, findings.without_check,
         "",
         "Check it once with an image that it never saw: run again with --hold-out {camera}"),
    Rule(GREEN, findings.always,
         "",
         "Use volume.vti (ParaView), volume.nrrd (3D Slicer) or volume.npz (Python), with "
         "half_width.* as error bars"),
)  # fmt: skip
"""What is said of a green volume."""
