"""What a report says is wrong: the cameras and the causes that it names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

WORDS: Mapping[str, str] = {
    "gain": r"\bgain",
    "background": r"background|dark",
    "pointing": r"\bpointing|\bshift|pixels off|disagree|refine|calibrat",
    "swapped": r"swapped|looks like camera",
    "mirrored": r"mirrored|upside down|turned by",
    "hidden": r"hidden|obstruct|covered",
    "saturation": r"saturat|full scale",
    "outside": r"outside the grid",
    "self-absorption": r"self-absor",
    "absorption": r"(?<!self-)absor",
    "vignetting": r"vignett",
    "blur": r"blur|focus",
    "out of step": r"out of step|another moment",
}
"""Words by which a cause is named in the first sentence of a warning: the rest is advice."""

UNEXPLAINED = r"unexplained|not explained"


@dataclass(frozen=True)
class Answer:
    """What a report says is wrong.

    Attributes
    ----------
    cameras : tuple of str
        The cameras that it names, in the rig's order.
    causes : tuple of str
        The causes that it names: keys of `WORDS`, in the order of the text.
    unexplained : bool
        Whether it says that the images are not explained.
    """

    cameras: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    unexplained: bool = False

    @property
    def silent(self) -> bool:
        """Whether nothing is said to be wrong."""
        return not (self.cameras or self.causes or self.unexplained)


def _in_order(line: str) -> list[str]:
    """Return the causes that a line names, in the order of its words."""
    found = {cause: re.search(words, line) for cause, words in WORDS.items()}
    places = {cause: match.start() for cause, match in found.items() if match}
    return sorted(places, key=places.__getitem__)


def answer_of(warnings: Sequence[str], names: Sequence[str]) -> Answer:
    """Return what a report says, the one place that reads reports.

    Parameters
    ----------
    warnings : sequence of str
    names : sequence of str
        All cameras, in the rig's order.
    """
    findings = [re.split(r"\. (?=[A-Z])", warning)[0] for warning in warnings]
    text = "\n".join(findings)
    cameras = [name for name in names if re.search(rf"\b{re.escape(name)}\b", text)]
    causes = [cause for line in findings for cause in _in_order(line)]
    unexplained = re.search(UNEXPLAINED, text) is not None
    return Answer(tuple(cameras), tuple(dict.fromkeys(causes)), unexplained)
