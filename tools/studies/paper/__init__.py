"""The experiments of arXiv 2010.00893, Pan, Li, Xu: a weight encode reconstruction network."""

from __future__ import annotations

from studies.common.study import Study

_PARTS = {
    "readings": "Readings of the text",
    "layouts": "Jet, three layouts of 33 cameras",
    "views": "Turbulent flame, 33 and 11 views",
    "ablation": "Without bias, bias and mask, batch normalisation",
    "normalisation": "Gradient normalisation",
    "denoising": "Noise of 10 % of the maximum, WERNet and ART",
    "transfer": "Encoders of other flames",
}
_RETRIES = {
    "smoother": "Noise again, on a flame as hard for ART as the paper's",
    "seeds": "Variants of the encoder again, three seeds and 80 epochs",
    "longer": "Encoders of the homogeneous set again, 80 epochs",
}
STUDY = Study(
    "paper",
    "The WERNet paper, run again.",
    {name: (title, f"studies.paper.experiments:{name}") for name, title in _PARTS.items()}
    | {name: (title, f"studies.paper.retries:{name}") for name, title in _RETRIES.items()},
    ("full", "half", "tiny"),
)
