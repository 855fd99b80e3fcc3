"""The default WERNet: a classic solve whose ray-voxel weights are learned from the images."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "correction": ["CorrectionEncoder", "ViewTokens"],
        "ray_features": ["RayFeatures"],
        "ray_weights": ["RayWeights"],
        "summary": ["LearnedWeights", "Profile"],
        "wernet": ["wernet"],
    },
)
