"""How far to trust a volume: views and angles, noise, intervals, resolution, warnings."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "assessment": ["AUTO_REPEATS", "Assessment", "assess"],
        "bootstrap": ["Deviations", "standard_deviations"],
        "intervals": ["Intervals", "intervals"],
        "part": ["SolveOf"],
        "residual_noise": ["Solve", "noise_of_images"],
        "resolution": [
            "Resolution",
            "half_widths",
            "resolution",
            "AngularCoverage",
            "view_coverage",
        ],
    },
)
