"""Rays, rotations, points and image motion."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={"points": ["box_points", "image_motion", "nearest_point", "point_in_view"]},
)
