"""Linear operators from the unknowns to the pixels, each with its exact adjoint."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "footprint": ["shadow_spread"],
        "gaussian_basis": ["GaussianBasis"],
        "image_blur": ["Defocused"],
        "lens_blur": ["spread_by", "spread_of"],
        "linear_basis": ["Splines"],
        "memory": [
            "BYTES_PER_MIDPOINT",
            "BYTES_PER_RAY",
            "BYTES_PER_SEGMENT",
            "BYTES_PER_VOXEL",
            "MemoryNeed",
            "ON_THE_FLY",
            "SAMPLED_RAYS",
            "STORED",
            "check_memory",
            "choose_form",
            "estimate_memory",
        ],
        "stored": ["Projector", "dot_test"],
        "system": ["LinearSystem"],
        "voxel_means": ["averages", "coefficients_of"],
    },
)
