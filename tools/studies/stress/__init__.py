"""The stress test: each part attacks one side of the toolkit; rows have bounds."""

from __future__ import annotations

from studies.common.study import Study
from studies.stress.row import measured

STUDY = Study(
    "stress",
    "Wrong pixels, views and cameras, rigs that say too little, other units and threads.",
    {
        "robustness": ("Bad pixels and wrong views", "studies.stress.robustness"),
        "trust": ("The standard deviations reported", "studies.stress.trust"),
        "conditioning": ("Few views, noise and stops", "studies.stress.conditioning"),
        "calibration": ("Calibration error", "studies.stress.calibration"),
        "geometry": ("Geometry and lenses", "studies.stress.geometry"),
        "order": ("Cameras in another order", "studies.stress.order"),
        "scaling": ("Other units of length and intensity", "studies.stress.scaling"),
        "threads": ("Threads and repeats", "studies.stress.threads"),
        "growth": ("Time and memory", "studies.stress.growth"),
    },
    ("full", "quick"),
    measured,
)
