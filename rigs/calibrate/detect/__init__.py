"""Detection of a target's points in images."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "detect": ["Detections", "detections", "find_target", "observe"],
        "image_sets": ["VideoFrame", "image_set"],
    },
)
