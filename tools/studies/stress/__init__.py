"""The stress test: each part attacks one side of the toolkit; rows have bounds."""

from __future__ import annotations

from studies.common.study import Study

STUDY = Study(
    "stress",
    "Wrong pixels, views and cameras, rigs that say too little, other units and threads.",
    {
        "robustness": ("Bad pixels and wrong views", "studies.stress.robustness"),
        "trust": ("The standard deviations reported", "studies.stress.trust"),
        "conditioning": ("Rigs, stops and focus", "studies.stress.conditioning"),
        "calibration": ("Calibration error", "studies.stress.calibration"),
        "scaling": ("Other units of length and intensity", "studies.stress.scaling"),
        "threads": ("Threads and repeats", "studies.stress.threads"),
    },
    ("full", "quick"),
)
