"""Pictures of rigs, volumes and calibrations: PNG, offline HTML and GLB."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "emission": ["Looks", "emission_image"],
        "film": ["visualize_film"],
        "frame": ["Viewpoint"],
        "light_row": ["light_row"],
        "rig.calibration_page": ["write_calibration_page"],
        "rig.visualize": ["visualize_check", "visualize_rig"],
        "scene": ["Label", "Mesh", "Scene"],
        "volume.visualize": ["visualize_volume"],
        "writers": ["write_glb", "write_html"],
    },
)
