"""What the scene needs, before anything is traced.

Memory, a volume in view, pixels to trust and their noise, and the voxels that dark pixels prove
empty. Names are loaded on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "aim": ["point_in_view"],
        "carving": ["Carving", "carve"],
        "memory": [
            "BYTES_PER_MIDPOINT",
            "BYTES_PER_RAY",
            "BYTES_PER_SEGMENT",
            "BYTES_PER_VOXEL",
            "ON_THE_FLY",
            "SAMPLED_RAYS",
            "STORED",
            "MemoryNeed",
            "check_memory",
            "choose_form",
            "estimate_memory",
        ],
        "noise_model": ["NoiseModel", "estimate_noise"],
        "pixel_weights": ["PixelWeights", "weigh_pixels"],
        "usable": ["usable_pixels"],
        "visual_hull": ["VisualHull", "visual_hull"],
    },
)
