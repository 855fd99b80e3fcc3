"""Refinement of poses, focal lengths and gains from the images of the scene itself."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "refinement": ["Refinement"],
        "moment": ["Moment"],
        "prior": ["prior_lengths"],
        "search": ["refine_cameras", "refine_over_moments"],
    },
)
