"""The answer of a reconstruction: whether its volume explains the images, in one sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tomo.pipeline.view import SURE, View

EXPLAINED, PARTLY, NOT_EXPLAINED, UNKNOWN_VERDICT = VERDICTS = (
    "explained",
    "partly explained",
    "not explained",
    "not known",
)

HARMFUL = 0.10
"""Fraction of an image, or of the emission, up to which an error is good. Lower: voxels leave more
of sharp edges; higher: a camera that is a pixel off."""


@dataclass(frozen=True)
class Answer:
    """Whether a volume explains the images that it was reconstructed from.

    The sentence does not name the worst view where it is not explained: wrong voxels miss some
    view most.
    """

    verdict: str
    worst: View | None = None  # explained least; None where no image is known or all are dark
    views: int = 0  # how many took part
    excluded: tuple[str, ...] = ()
    missed: float = 0.0  # root mean square of the views' relative residuals beyond noise
    preview: str = ""  # what the sentence begins with where this is a preview

    @property
    def sentence(self) -> str:
        """The answer in one sentence."""
        return self.preview + self._plainly()

    def _plainly(self) -> str:
        worst = self.worst
        if worst is None:
            return "Not known: there is no image with light to compare the volume with."
        without = f", without {_cameras(self.excluded)}" if self.excluded else ""
        noise = f"noise is {percent(worst.relative_noise)}"
        if self.verdict == EXPLAINED:
            images = "the image" if self.views == 1 else f"the images of all {self.views} cameras"
            return (
                f"Explained: the volume reproduces {images} up to the noise{without}; least well "
                f"that of camera {worst.name}, where the residual is "
                f"{percent(worst.relative_residual)}, {noise}."
            )
        if not worst.beyond_noise:
            missed = f"details finer than voxels, {percent(worst.relative_residual)} of an image"
        else:
            missed = f"{percent(worst.beyond_noise)} of an image, {percent(self.missed)} of all"
        begin = "Explained but for" if self.verdict == PARTLY else "Not explained:"
        return f"{begin} {missed}{without}; {noise}."

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
        }


def answer_of(outcome: Any) -> Answer:
    """Return whether the volume of a `tomo.Reconstruction` explains the views that took part."""
    views = [view for view in outcome.views if view.takes_part]
    excluded = tuple(view.name for view in outcome.views if view.excluded)
    worst, preview = worst_view(views), _of_preview(outcome.preview)
    if worst is None:
        return Answer(UNKNOWN_VERDICT, None, len(views), excluded, preview=preview)
    beyond = [view.beyond_noise for view in views if math.isfinite(view.beyond_noise)]
    missed = math.sqrt(math.fsum(one**2 for one in beyond) / len(beyond))
    return Answer(verdict_of(worst), worst, len(views), excluded, missed, preview)


def _of_preview(times: int | None) -> str:
    """Return what a preview's answer begins with; ``times`` as wide are its pixels and voxels."""
    if times is None:
        return ""
    wider = f"pixels and voxels {times} times as wide, " if times > 1 else ""
    return f"Preview ({wider}nothing corrected): "


def verdict_of(view: View) -> str:
    """Return whether one view is explained, from its residual and its own noise."""
    if not math.isfinite(view.beyond_noise):
        return UNKNOWN_VERDICT
    if view.beyond_noise > HARMFUL:
        return NOT_EXPLAINED
    is_noise = not view.beyond_noise and not view.residual_over_noise > SURE
    return EXPLAINED if is_noise or not view.relative_residual else PARTLY


def worst_view(views: Sequence[View]) -> View | None:
    """Return the view explained least, by verdict, then residual beyond noise; None: all dark."""
    lit = [view for view in views if math.isfinite(view.beyond_noise)]
    return max(
        lit, key=lambda one: (VERDICTS.index(verdict_of(one)), one.beyond_noise), default=None
    )


def percent(fraction: float) -> str:
    """Return a fraction in per cent, to two digits or a tenth."""
    return f"{fraction:.0%}" if fraction >= 0.0995 else f"{fraction:.1%}"


def _cameras(names: Sequence[str]) -> str:
    return ("cameras " if len(names) > 1 else "camera ") + ", ".join(names)
