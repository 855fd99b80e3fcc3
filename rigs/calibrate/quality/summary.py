"""A calibration's figures as plain data, for the rig's file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rigs.files.text import plain
from rigs.scene.scene_camera import own_camera

if TYPE_CHECKING:
    from rigs.calibrate.result import Calibration

_DIGITS = 6  # significant ones, in files


def summary(calibration: Calibration) -> dict[str, Any]:
    """Return the figures of the rig, and under ``cameras`` those of each camera."""
    quality, used = calibration.quality, calibration.used
    cameras = {}
    for index, camera in enumerate(calibration.rig):
        own = calibration.observations.camera == index
        cameras[camera.name] = {
            "images": int(np.isfinite(quality.image_rms[index]).sum()),
            "points_used": int((own & used).sum()),
            "points_left_out": int((own & ~used).sum()),
            "lens_terms": calibration.terms[index],
            "rms_px": plain(quality.camera_rms[index], _DIGITS),
            "image_coverage": plain(quality.image_coverage[index], _DIGITS),
            "volume_coverage": plain(quality.volume_coverage[index], _DIGITS),
            "depth_range": plain(quality.depth_range[index].tolist(), _DIGITS),
            "focal_length_error": plain(quality.focal_error[index], _DIGITS),
            "ray_miss": plain(quality.camera_ray_miss[index], _DIGITS),
        }
    step = calibration.synchrony
    if step is not None:
        for index, figures in enumerate(cameras.values()):
            figures["time_offset_frames"] = plain(step.offset[index], _DIGITS)
            figures["time_offset_error_frames"] = plain(step.error[index], _DIGITS)
            figures["out_of_step"] = bool(step.is_out[index])
    for own, figures in zip(calibration.looked_through, cameras.values(), strict=False):
        figures["looked_through"] = list(own)
    windows = {window.name: plain(window.figures(), _DIGITS) for window in calibration.windows}
    return {
        "method": "target images, joint adjustment of lenses, camera poses and target poses",
        "rms_px": plain(np.sqrt((calibration.residuals[used] ** 2).sum(axis=1).mean()), _DIGITS),
        "noise_px": plain(calibration.noise, _DIGITS),
        "frames": int(np.isfinite(quality.frame_rms).sum()),
        "points_used": int(used.sum()),
        "points_left_out": int((~used).sum()),
        "held": calibration.gauge,
        "length_unit": calibration.rig.length_unit,
        "ray_miss_predicted": plain(quality.predicted_ray_miss, _DIGITS),
        "ray_miss_between_halves": plain(quality.cross_ray_miss, _DIGITS),
        "ray_miss_between_halves_expected": plain(quality.cross_expected, _DIGITS),
        "pixel_footprint": plain(np.nanmedian(quality.footprint), _DIGITS),
        "findings": list(calibration.findings),
        "assessment": calibration.assessment,
        "cameras": cameras,
        **({"windows": windows} if windows else {}),
        "target_poses": _target_poses(calibration),
    }


def _target_poses(calibration: Calibration) -> list[dict[str, Any]]:
    """Return the target's corners in each frame, in the axes of the camera whose pose was held.

    These stay valid when the rig's world changes.
    """
    points = calibration.observations.target_points
    (left, top), (right, bottom) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    border = np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])
    camera = own_camera(calibration.rig[calibration.gauge])
    poses = []
    for index, frame in enumerate(calibration.observations.frames):
        R, t = calibration.target_R[index], calibration.target_t[index]
        if np.isfinite(t).all():
            corners = (border @ R.T + t) @ camera.R.T + camera.t
            rows = plain(corners.tolist(), _DIGITS)
            poses.append({"frame": frame, "camera": camera.name, "corners": rows})
    return poses
