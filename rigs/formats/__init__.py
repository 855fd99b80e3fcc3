"""File formats of rigs, one module each; foreign conventions end here."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "anipose",
        "astra",
        "colmap",
        "dlt",
        "dlt_bottom",
        "dlt_matlab",
        "emission_rig",
        "kalibr",
        "middlebury",
        "multical",
        "myptv",
        "opencv",
        "openptv",
        "projection",
        "registry",
        "rtk",
        "transforms",
    ],
    submod_attrs={"registry": ["FORMATS", "load", "names", "save", "sniff"]},
)
