"""Pictures of rigs, volumes and calibrations: PNG, offline HTML and GLB."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "scene": ["Label", "Mesh", "Scene"],
        "viewpoint": ["Viewpoint"],
        "write_glb": ["write_glb"],
        "write_html": ["write_html"],
    },
)
