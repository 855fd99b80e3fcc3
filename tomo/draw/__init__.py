"""Pictures of rigs, volumes and calibrations: PNG, offline HTML and GLB."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "calibration.calibration_page": ["write_calibration_page"],
        "emission": ["Looks", "emission_image"],
        "film.visualize": ["visualize_film"],
        "light_row": ["light_row"],
        "rig.visualize": ["visualize_check", "visualize_rig"],
        "scene": ["Label", "Mesh", "Scene"],
        "viewpoint": ["Viewpoint"],
        "volume.visualize": ["visualize_volume"],
        "write_glb": ["write_glb"],
        "write_html": ["write_html"],
    },
)
