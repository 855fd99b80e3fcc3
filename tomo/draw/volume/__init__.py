"""Pictures of volumes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "isosurface": ["coarsened", "isosurface", "isosurface_scene"],
        "visualize": ["draw_volume"],
    },
)
