"""Lenses out of focus: how far, found in the images, and projectors that spread light as they do.

`blur_of_images` finds the diameter of the disc, `spread_of` what it does to the pixels of a rig
(`spread_by` what any shares do), and `Defocused` is a projector seen through it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "defocused": ["Defocused"],
        "spectrum": ["blur_of_images"],
        "spread": ["spread_by", "spread_of"],
    },
)
