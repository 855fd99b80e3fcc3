"""The benchmark: each part measures one thing and returns plain rows."""

from __future__ import annotations

from studies.common.study import Study

STUDY = Study(
    "benchmark",
    "Run time against error, with memory, start-up and accuracy.",
    {
        "accuracy": ("The default against the truth", "studies.benchmark.accuracy"),
        "projectors": ("Projectors", "studies.benchmark.projectors"),
        "solvers": ("Solvers", "studies.benchmark.solvers"),
        "skipping": ("Skipping of what is proved empty", "studies.benchmark.skipping"),
        "plume": ("A real plume", "studies.benchmark.plume"),
        "gpu": ("On a GPU", "studies.benchmark.gpu"),
        "scaling": ("Growth with grid and views", "studies.benchmark.scaling"),
        "startup": ("Start-up and first use", "studies.benchmark.startup"),
        "mismatch": ("Physics that solvers do not know", "studies.benchmark.mismatch"),
        "learned": ("Optics without a formula", "studies.scenes.learned"),
        "training": ("Training WERNet", "studies.benchmark.training"),
        "optics": ("Flames behind optics", "studies.optics.study"),
        "calibration": ("Calibration against known rigs", "studies.calibration.study"),
        "refinement": ("Cameras refined from the flame", "studies.refinement"),
    },
    together=("mismatch", "optics", "accuracy", "refinement", "plume", "solvers", "learned"),
)
