"""One reconstruction: its options, its stages in their order, and its result."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "options": ["Options"],
        "reconstruction": ["Reconstruction"],
        "reconstruct": ["preview", "reconstruct"],
    },
)
