"""Lines of sight: straight pieces grouped by pixel, and where they enter and leave the grid."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "rays": ["Rays"],
    },
)
