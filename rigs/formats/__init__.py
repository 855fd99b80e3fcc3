"""Foreign formats, one module each; their conventions end here."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["colmap", "emission_rig", "middlebury", "opencv", "registry", "transforms"],
    submod_attrs={"registry": ["FORMATS", "load", "names", "save", "sniff"]},
)
