"""How well-posed a scene is, and how far its reconstruction is to be trusted.

Views and angular gaps of the voxels that emit, the standard deviation that noise leaves in every
voxel, the resolution, and plain warnings.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "_deviations": ["Deviations", "standard_deviations"],
        "_noise": ["Solve", "noise_of_images"],
        "_resolution": ["Resolution", "half_widths", "resolution"],
        "_seeing": ["Seeing", "seeing"],
        "assessment": ["AUTO_REPEATS", "Condition", "assess"],
    },
)
