"""Voxels between whose centres the emission runs straight, instead of boxes of even emission.

`Splines` is the projector of such a volume, `shadow_spread` what makes it of the chords of boxes,
and `averages` the mean emission in every voxel, which is what a volume holds.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "averages": ["averages", "coefficients_of"],
        "operator": ["Splines"],
        "shadow": ["shadow_spread"],
    },
)
