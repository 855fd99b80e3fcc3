"""Basis functions of the emission other than voxels: operators ``A M`` of their coefficients."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "footprint": ["footprint_blur"],
        "gaussian": ["GaussianBasis"],
        "linear": ["LinearBasis", "coefficients_of", "voxel_means"],
    },
)
