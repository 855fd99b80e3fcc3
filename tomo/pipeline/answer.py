"""The answer of a reconstruction: whether its volume explains the images, in one sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tomo.pipeline.view import View

EXPLAINED, PARTLY, NOT_EXPLAINED, UNKNOWN_VERDICT = VERDICTS = (
    "explained",
    "partly explained",
    "not explained",
    "not known",
)

UNKNOWN = (
    "no cause that was tested explains it: the flame may have moved between exposures, or voxels "
    "are too large for it"
)
"""What is said where nothing was found wrong."""

NEGLIGIBLE = 0.04
"""Largest residual beyond noise, as a fraction of the view, at which it is explained: voxels leave
so much of sharp edges in clean images. Lower: faultless scenes are not explained."""

HARMFUL = 0.10
"""Residual beyond noise, as a fraction of the view, from which it is not explained."""

MOST_TIMES = 20.0
"""Ratio of residual to noise above which the ratio is not said: nearly clean images."""


@dataclass(frozen=True)
class Answer:
    """Whether a volume explains the images that it was reconstructed from.

    Attributes
    ----------
    verdict : str
        One of `VERDICTS`.
    worst : View, optional
        The view that is explained least; None where no image is known or all are dark. The
        sentence does not name it where it is not explained: wrong voxels miss some view most.
    views : int
        How many took part.
    excluded : tuple of str
        The cameras that were left out because the others contradict them.
    causes : tuple of str
        What the stages found that may be wrong, where not everything is explained.
    missed : float
        Root mean square over the views of their residuals beyond noise, each relative to its view.
    """

    verdict: str
    worst: View | None = None
    views: int = 0
    excluded: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    missed: float = 0.0

    @property
    def sentence(self) -> str:
        """The answer in one sentence."""
        if self.worst is None:
            return "Not known: there is no image with light to compare the volume with."
        worst, without = self.worst, ""
        if self.excluded:
            contradicted = "them" if len(self.excluded) > 1 else "it"
            without = f", without {_cameras(self.excluded)} (the other views contradict "
            without += f"{contradicted})"
        figures = f"residual {_percent(worst.relative_residual)}, noise "
        figures += _percent(worst.relative_noise)
        if self.verdict == EXPLAINED:
            rest = ""
            if worst.beyond_noise:
                rest = f", but for at most {_percent(worst.beyond_noise)} of an image"
            return (
                f"Explained: the volume reproduces {self._images} up to their noise{rest}"
                f"{without}; least well that of camera {worst.name} ({figures})."
            )
        begin = "Not explained" if self.verdict == NOT_EXPLAINED else f"Explained {self._how_far}"
        return (
            f"{begin}: up to {_percent(worst.beyond_noise)} of an image stays unexplained beyond "
            f"its noise, {_percent(self.missed)} of all images{without}"
            + (f"; likely causes: {'; '.join(self.causes)}." if self.causes else f"; {UNKNOWN}.")
        )

    @property
    def _how_far(self) -> str:
        times = self.worst.residual_over_noise if self.worst else math.inf
        return f"within {times:.1f} times the noise" if times <= MOST_TIMES else "in part"

    @property
    def _images(self) -> str:
        return "the image" if self.views == 1 else f"the images of all {self.views} cameras"

    def report(self) -> dict[str, Any]:
        """Return ``report.json``'s ``answer``."""
        worst = self.worst
        return {
            "sentence": self.sentence,
            "verdict": self.verdict,
            "worst_camera": worst.name if worst else None,
            "residual_over_noise": worst.residual_over_noise if worst else None,
            "beyond_noise": worst.beyond_noise if worst else None,
            "beyond_noise_of_all": self.missed if worst else None,
            "causes": list(self.causes),
        }


def answer_of(outcome: Any) -> Answer:
    """Return whether the volume of a `tomo.Reconstruction` explains the views that took part."""
    views = [view for view in outcome.views if view.takes_part]
    excluded = tuple(view.name for view in outcome.views if view.excluded)
    worst = worst_view(views)
    if worst is None:
        return Answer(UNKNOWN_VERDICT, views=len(views), excluded=excluded)
    verdict = verdict_of(worst)
    causes = () if verdict == EXPLAINED else tuple(one.sentence for one in outcome.findings)
    beyond = [view.beyond_noise for view in views if math.isfinite(view.beyond_noise)]
    missed = math.sqrt(math.fsum(one**2 for one in beyond) / len(beyond))
    return Answer(verdict, worst, len(views), excluded, causes, missed)


def verdict_of(view: View) -> str:
    """Return whether one view is explained, from its residual and its own noise."""
    if not math.isfinite(view.beyond_noise):
        return UNKNOWN_VERDICT
    if view.beyond_noise <= NEGLIGIBLE:
        return EXPLAINED
    return NOT_EXPLAINED if view.beyond_noise > HARMFUL else PARTLY


def worst_view(views: Sequence[View]) -> View | None:
    """Return the view that is explained least; None where there is none with light.

    The verdict comes first, then the residual beyond noise.
    """
    lit = [view for view in views if math.isfinite(view.beyond_noise)]
    order = {EXPLAINED: 0, PARTLY: 1, NOT_EXPLAINED: 2}
    return max(lit, key=lambda one: (order[verdict_of(one)], one.beyond_noise), default=None)


def _cameras(names: Sequence[str]) -> str:
    return ("cameras " if len(names) > 1 else "camera ") + ", ".join(names)


def _percent(fraction: float) -> str:
    """Return a fraction of the image in per cent, to two digits or a tenth."""
    return f"{fraction:.0%}" if fraction >= 0.0995 else f"{fraction:.1%}"
