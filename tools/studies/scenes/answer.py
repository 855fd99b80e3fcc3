"""What a report says is wrong: the cameras and the causes that it names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from tomo import Reconstruction

WORDS: Mapping[str, str] = {
    "gain": r"\bgain",
    "background": r"background|dark",
    "pointing": r"\bshift|pixels off|disagree|refine|calibrat",
    "swapped": r"looks like camera",
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
"""Words in warnings by which a cause is named."""


@dataclass(frozen=True)
class Answer:
    """What a report says is wrong.

    Attributes
    ----------
    cameras : tuple of str
        The cameras that it names, in the rig's order.
    causes : tuple of str
        The causes that it names: keys of `WORDS`, the likeliest first where it has an order.
    """

    cameras: tuple[str, ...]
    causes: tuple[str, ...]

    @property
    def silent(self) -> bool:
        """Whether nothing is said to be wrong."""
        return not self.cameras and not self.causes


def answer_of(outcome: Reconstruction) -> Answer:
    """Return what the report of a reconstruction says; the one place that reads reports."""
    text = "\n".join(outcome.warnings)
    cameras = [name for name in outcome.rig.names if re.search(rf"\b{re.escape(name)}\b", text)]
    return Answer(tuple(cameras), tuple(c for c, words in WORDS.items() if re.search(words, text)))
