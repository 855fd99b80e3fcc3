"""A calibration's figures as plain data, to travel in the rig's file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rigs.calibrate.calibration import Calibration


def summary(calibration: Calibration) -> dict[str, Any]:
    """Return the figures: of the whole, and under ``cameras`` of each."""
    quality, used = calibration.quality, calibration.used
    cameras = {}
    for index, camera in enumerate(calibration.rig):
        own = calibration.observations.camera == index
        cameras[camera.name] = {
            "images": int(np.isfinite(quality.image_rms[index]).sum()),
            "points_used": int((own & used).sum()),
            "points_left_out": int((own & ~used).sum()),
            "lens_terms": calibration.terms[index],
            "rms_px": _plain(quality.camera_rms[index]),
            "image_coverage": _plain(quality.image_coverage[index]),
            "volume_coverage": _plain(quality.volume_coverage[index]),
            "depth_range": [_plain(depth) for depth in quality.depth_range[index]],
            "focal_length_error": _plain(quality.focal_error[index]),
            "ray_miss": _plain(quality.camera_ray_miss[index]),
        }
    return {
        "method": "target images, joint adjustment of lenses, camera poses and target poses",
        "rms_px": _plain(np.sqrt((calibration.residuals[used] ** 2).sum(axis=1).mean())),
        "noise_px": _plain(calibration.noise),
        "frames": int(np.isfinite(quality.frame_rms).sum()),
        "points_used": int(used.sum()),
        "points_left_out": int((~used).sum()),
        "held": calibration.gauge,
        "ray_miss_predicted": _plain(quality.predicted_ray_miss),
        "ray_miss_between_halves": _plain(quality.cross_ray_miss),
        "ray_miss_between_halves_expected": _plain(quality.cross_expected),
        "pixel_footprint": _plain(np.nanmedian(quality.footprint)),
        "findings": list(calibration.findings),
        "verdict": calibration.verdict,
        "cameras": cameras,
    }


def _plain(value: float) -> float | None:
    """Return a number as files keep it: six digits, None where there is none."""
    return float(f"{value:.6g}") if np.isfinite(value) else None
