"""What stands in the light's way: windows, hardware, mirrors, gas; lines of sight through them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "surfaces": ["INDICES", "Glass", "Material", "Opaque", "Reflecting", "index_of"],
        "mesh": ["Mesh"],
        "paths": ["Paths"],
        "plates": ["Mirror", "Window"],
        "scene": ["Scene"],
        "scene_camera": ["SceneCamera"],
        "solids": ["Cylinder", "Solid", "Sphere"],
    },
)
