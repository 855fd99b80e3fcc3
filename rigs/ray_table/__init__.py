"""A camera that is a table of rays: mirrors, fibre bundles, windows, any optics at all."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "ray_table": ["RayTable"],
    },
)
