"""File formats of rigs, one module each; foreign conventions end here."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"registry": ["FORMATS", "load", "names", "rigs_in", "save", "sniff"]}
)
