"""Rays, rotations, points and image motion."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "aim": ["point_in_view"],
        "box_points": ["box_points"],
        "image_motion": ["image_motion"],
        "lines": ["nearest_point", "ray_distances", "ray_miss"],
    },
)
