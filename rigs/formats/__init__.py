"""File formats of rigs, one module each; foreign conventions end here."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "alicevision",
        "anipose",
        "astra",
        "bundler",
        "camera_table",
        "colmap",
        "dlt",
        "easymocap",
        "emission_rig",
        "gaussian_splatting",
        "kalibr",
        "kitti",
        "metashape",
        "middlebury",
        "mrcal",
        "multical",
        "myptv",
        "opencv",
        "openptv",
        "opensfm",
        "pix4d",
        "projection",
        "qualisys",
        "realitycapture",
        "registry",
        "rtk",
        "transforms",
    ],
    submod_attrs={"registry": ["FORMATS", "load", "names", "rigs_in", "save", "sniff"]},
)
