"""The voxels that dark pixels prove empty, and the hulls of opaque things."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "carving": ["Carving", "carve"],
        "opaque": ["VisualHull", "visual_hull"],
    },
)
