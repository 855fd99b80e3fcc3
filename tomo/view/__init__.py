"""Pictures: rigs and volumes as PNG, offline HTML and GLB, and the report of a reconstruction.

Geometry is made once, as a `Scene` of named coloured meshes and labels; three writers draw it:
a ray caster on Open3D's RaycastingScene (no display, no GPU), plotly, and trimesh.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["shapes"],
    submod_attrs={
        "calibration_page": ["write_calibration_page"],
        "isosurface": ["coarsened", "isosurface", "isosurface_scene"],
        "report": ["write_report"],
        "results": ["Convergence", "Picture", "Results", "View", "draw", "write_pictures"],
        "rig_picture": ["draw_rig", "write_rig"],
        "rig_scene": ["frustum", "rig_scene"],
        "scene": ["Label", "Mesh", "Scene"],
        "viewpoint": ["Viewpoint"],
        "volume_picture": ["draw_volume", "write_volume_picture"],
        "write_glb": ["write_glb"],
        "write_html": ["write_html"],
    },
)
