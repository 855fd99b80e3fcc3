"""Cameras and rigs: projection of points, rays of pixels, calibration, file formats.

Names are loaded on first use, so that ``import rigs`` is fast.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["formats"],
    submod_attrs={
        "camera": ["Camera", "look_at"],
        "camera_protocol": ["CameraLike"],
        "check": ["Coverage", "check_rig", "compare_rigs", "ray_distances", "ray_miss"],
        "files": ["load_rig", "preset", "preset_names", "save_rig"],
        "geometry": ["box_points", "image_motion", "nearest_point", "point_in_view"],
        "layouts": ["arc", "ring"],
        "lens": ["Distortion"],
        "optics": ["Optics"],
        "ray_table": ["RayTable"],
        "rig": ["Rig", "Volume"],
    },
)
