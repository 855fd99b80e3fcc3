"""File formats of rigs, one module each; foreign conventions end here."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "anipose",
        "astra",
        "blender",
        "bop",
        "bundler",
        "colmap",
        "dlt",
        "dlt_bottom",
        "dlt_matlab",
        "easymocap",
        "emission_rig",
        "gaussian_splatting",
        "kalibr",
        "mccalib",
        "metashape",
        "middlebury",
        "mrcal",
        "multical",
        "mvsnet",
        "myptv",
        "nvm",
        "opencv",
        "openmvg",
        "openptv",
        "projection",
        "registry",
        "rtk",
        "transforms",
    ],
    submod_attrs={"registry": ["FORMATS", "load", "names", "save", "sniff"]},
)
