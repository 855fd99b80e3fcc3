"""A calibration's figures as plain data, to travel in the rig's file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rigs.calibrate.result import Calibration


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
        "length_unit": calibration.rig.length_unit,
        "ray_miss_predicted": _plain(quality.predicted_ray_miss),
        "ray_miss_between_halves": _plain(quality.cross_ray_miss),
        "ray_miss_between_halves_expected": _plain(quality.cross_expected),
        "pixel_footprint": _plain(np.nanmedian(quality.footprint)),
        "findings": list(calibration.findings),
        "verdict": calibration.verdict,
        "cameras": cameras,
        "target_poses": _target_poses(calibration),
    }


def _target_poses(calibration: Calibration) -> list[dict[str, Any]]:
    """Return where the target was held: its corners in the axes of the camera that was held.

    Not in the world: so they stay true when the rig is moved.
    """
    points = calibration.observations.target_points
    (left, top), (right, bottom) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    border = np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])
    camera = calibration.rig[calibration.gauge]
    poses = []
    for index, frame in enumerate(calibration.observations.frames):
        R, t = calibration.target_R[index], calibration.target_t[index]
        if np.isfinite(t).all():
            corners = (border @ R.T + t) @ camera.R.T + camera.t
            rows = [[_plain(value) for value in corner] for corner in corners]
            poses.append({"frame": frame, "camera": camera.name, "corners": rows})
    return poses


def _plain(value: float) -> float | None:
    """Return a number as files keep it: six digits, None where there is none."""
    return float(f"{value:.6g}") if np.isfinite(value) else None
