"""Cameras by stored rays: mirrors, fibre bundles, windows, any optics."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"ray_table": ["RayTable"]}
)
