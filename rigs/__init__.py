"""Cameras and rigs: projection of points, rays of pixels, calibration, checks, file formats.

The nouns:

- `Camera`: name, image size, camera matrix, `Distortion`, pose. OpenCV's axes; pixel centres at
  integers. `RayTable` is a camera given as one ray for every pixel.
- `Rig`: cameras in order: ``rig[3]``, ``rig["cam03"]``, ``rig.without("cam03")``. A notebook draws
  it.
- `Volume`: the voxels that a rig was made for.

The verbs: `load` reads a preset, a rig.yaml or any known format, `save_rig` and
``rigs.formats.save`` write; `ring` and `arc` make virtual rigs, `camera_at` a camera by
its place and its lens; `calibrate_rig` makes a rig of
images of a target; `check_rig` says whether a rig is good enough for a volume, `compare_rigs` how
two differ; `with_images_changed` follows cropped, turned and binned images.

Examples
--------
A ring of cameras, where it sees the origin, and whether it is good enough for a volume:

>>> import rigs
>>> rig = rigs.ring(12, distance=500, image_size=(72, 96), footprint=0.3, pitch_degrees=10)
>>> uv, depth, valid = rig["cam00"].project([[0, 0, 0]])
>>> uv.round(3).tolist(), depth.round(3).tolist()
([[35.5, 47.5]], [500.0])
>>> check = rigs.check_rig(rig, rigs.Volume((24, 40, 24), 0.5))
>>> check.assessment
'good'

Go on with ``help(rigs.Rig)``, ``help(rigs.calibrate_rig)`` and the page "Your cameras" of the
documentation.

Names are loaded on first use, so that ``import rigs`` is fast.
"""

from rigs.lazy_names import attach

__getattr__, __dir__, __all__ = attach(
    __name__,
    submodules=["calibrate", "formats"],
    submod_attrs={
        "calibrate": ["calibrate_rig"],
        "camera": ["Camera", "look_at"],
        "camera_protocol": ["CameraLike"],
        "changes": ["ImageChange", "as_ray_tables", "with_cameras", "with_images_changed"],
        "check": ["Coverage", "check_rig", "compare_rigs", "ray_distances", "ray_miss"],
        "figures": ["Accuracy", "Optics"],
        "files": ["load_rig", "load_world", "save_rig"],
        "geometry": ["box_points", "image_motion", "nearest_point", "point_in_view"],
        "layouts": ["arc", "ring", "camera_at"],
        "lens": ["Distortion"],
        "loading": ["load", "preset", "preset_names"],
        "ray_table": ["RayTable"],
        "rig": ["Rig", "Volume"],
    },
)
