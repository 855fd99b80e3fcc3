"""From a known emission to the images that a rig's cameras would take of it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "effects": ["Effects"],
        "film": ["simulate_film"],
        "simulate": ["SimulatedImages", "simulate", "simulate_images"],
    },
)
