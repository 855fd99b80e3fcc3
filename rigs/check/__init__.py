"""Is a rig good enough for a volume, where is it not, and which camera is responsible."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "compare": ["compare_rigs"],
        "coverage": ["Coverage"],
        "lines_of_sight": ["ray_distances", "ray_miss"],
        "rig_check": ["check_points", "check_rig", "convention_errors_in", "scale_for"],
    },
)
