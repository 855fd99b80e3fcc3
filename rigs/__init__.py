"""Cameras and rigs: where each pixel of each camera looks, and nothing about what it sees.

Names are loaded on first use, so that ``import rigs`` costs nothing that is not needed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["formats", "paper"],
    submod_attrs={
        "box": ["box_points"],
        "camera": ["Camera", "look_at"],
        "compare": ["compare_rigs"],
        "coverage": ["Coverage"],
        "distortion": ["Distortion"],
        "file": ["load_rig", "preset", "preset_names", "save_rig"],
        "lines": ["nearest_point", "ray_distances", "ray_miss"],
        "motion": ["image_motion"],
        "optics": ["Optics"],
        "ray_table": ["RayTable"],
        "rig": ["Rig", "Volume"],
        "rig_check": ["check_rig"],
        "virtual": ["arc", "ring"],
    },
)
