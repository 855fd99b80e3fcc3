"""Pictures and pages of camera rigs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "rig_picture": ["draw_rig"],
        "rig_scene": ["frustum", "rig_scene"],
    },
)
