"""Calibration: from images of a flat target to a rig, and how far that rig can be trusted."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "adjust.film": ["frame_times"],
        "calibration": ["calibrate"],
        "detect.detect": ["Detections", "detections", "find_target", "observe"],
        "detect.image_sets": ["VideoFrame", "image_set"],
        "from_images": ["calibrate_rig"],
        "observations": ["Observations"],
        "quality.quality": ["Quality"],
        "result": ["Calibration"],
        "synchrony": ["Synchrony"],
        "refraction.refraction": ["WindowPrior"],
        "targets.boards": ["CharucoBoard", "Chessboard", "parse_target"],
        "targets.circle_grid": ["CircleGrid"],
    },
)
