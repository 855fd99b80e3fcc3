"""Targets seen through windows and tubes: lines of sight, and windows that are adjusted."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "refraction": ["Refraction", "WindowPrior"],
        "routes": ["HIDDEN", "NONE", "PASSES", "REFLECTED", "routes_to"],
    },
)
