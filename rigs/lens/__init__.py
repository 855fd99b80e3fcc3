"""OpenCV's models of lens distortion."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"distortion": ["Distortion", "turned"]}
)
