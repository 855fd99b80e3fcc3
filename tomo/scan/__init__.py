"""Images of calibrated cameras and their rig, on disk and in memory."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "image_source": ["Frame"],
        "corrections": ["Corrections"],
        "files": ["load_scan"],
        "image_folder": ["scan_of_images"],
        "radiometry": ["Calibration", "Radiometry"],
        "scan": ["Scan"],
        "write": ["save_scan"],
    },
)
