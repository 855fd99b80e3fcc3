"""A calibrated rig with the figures that say how far it can be trusted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.observations import Observations
from rigs.calibrate.quality.quality import Quality
from rigs.calibrate.quality.windows import AdjustedWindow
from rigs.calibrate.synchrony import Synchrony
from rigs.files.text import plain
from rigs.rig import Rig
from rigs.scene.scene_camera import own_camera

_DIGITS = 6  # significant ones, in files


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """A calibrated rig and the figures that say how far it can be trusted.

    Parameters
    ----------
    rig : Rig
        Its ``calibration`` holds the figures as plain data.
    observations : Observations
        The observations it was made from.
    residuals : (observations, 2) float64
        Measured less projected, pixels; NaN where the frame has no pose.
    used : (observations,) bool
        False where an observation was left out: an outlier, a repeated image, or in a frame
        without pose.
    target_R, target_t : (frames, 3, 3), (frames, 3) float64
        ``x_world = R x_target + t``; NaN where a frame has no pose.
    terms : tuple of str
        Each camera's lens terms, named as in `rigs.calibrate.calibrate`, or "given".
    noise : float
        Standard deviation of a pixel coordinate, from the residuals used.
    parameters : tuple of (str, str)
        Camera and name of each free parameter: wx wy wz (rotation vector multiplied from the
        left, radians), tx ty tz (length units), fx fy cx cy (pixels), c0 c1 ... (coefficients).
        Adjusted windows come last, by their names: tilt_1 tilt_2 (radians), distance, thickness.
    covariance : (parameters, parameters) float64
        Their covariance, while the pose of camera ``gauge`` is held.
    gauge : str
        Name of that camera.
    quality : Quality
    findings : tuple of str
        Warnings and then notes on what was left out, a line each: cameras and frames by name.
    assessment : str
        The predicted ray-miss, its meaning, then the findings.
    synchrony : Synchrony, optional
        The cameras' offsets in time; None where no film shows a target that moves.
    windows : tuple of AdjustedWindow
        Windows that were adjusted.
    looked_through : tuple of tuple of str
        The solids of the scene that each camera saw the target through; empty without a scene.
    notes : tuple of str
        Lines on the images and files, by `rigs.calibrate_rig`.
    images : mapping of camera to mapping of frame to source, optional
        The images that were searched, by `rigs.calibrate_rig`.
    """

    rig: Rig
    observations: Observations
    residuals: NDArray[np.float64]
    used: NDArray[np.bool_]
    target_R: NDArray[np.float64]  # noqa: N815 (the field's symbol)
    target_t: NDArray[np.float64]
    terms: tuple[str, ...]
    noise: float
    parameters: tuple[tuple[str, str], ...]
    covariance: NDArray[np.float64]
    gauge: str
    quality: Quality
    findings: tuple[str, ...]
    assessment: str
    synchrony: Synchrony | None = None
    windows: tuple[AdjustedWindow, ...] = ()
    looked_through: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = ()
    images: Mapping[str, Mapping[str, Any]] | None = None

    def __repr__(self) -> str:
        rms = np.sqrt((self.residuals[self.used] ** 2).sum(axis=1).mean())
        return (
            f"<Calibration: {len(self.rig)} cameras, {int(self.used.sum())} of {len(self.used)} "
            f"observations, RMS {rms:.3g} px>"
        )

    def report(self) -> dict[str, Any]:
        """Return every figure as plain data, what was left out, and the notes."""
        observations, quality = self.observations, self.quality
        figures = {
            "length_unit": self.rig.length_unit,
            "notes": list(self.notes),
            **(self.rig.calibration or {}),
            "frames_rms_px": dict(zip(observations.frames, quality.frame_rms, strict=True)),
            "images_rms_px": {
                camera: {
                    frame: rms
                    for frame, rms in zip(observations.frames, row, strict=True)
                    if math.isfinite(rms)
                }
                for camera, row in zip(observations.cameras, quality.image_rms, strict=True)
            },
            "left_out": [
                {
                    "camera": observations.cameras[observations.camera[k]],
                    "frame": observations.frames[observations.frame[k]],
                    "point": int(observations.point[k]),
                    "uv": list(observations.uv[k]),
                    "residual_px": list(self.residuals[k]),
                }
                for k in np.flatnonzero(~self.used)
            ],
        }
        return plain(figures, _DIGITS)


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
            "rms_px": quality.camera_rms[index],
            "image_coverage": quality.image_coverage[index],
            "volume_coverage": quality.volume_coverage[index],
            "depth_range": quality.depth_range[index].tolist(),
            "focal_length_error": quality.focal_error[index],
            "ray_miss": quality.camera_ray_miss[index],
        }
    step = calibration.synchrony
    if step is not None:
        for index, figures in enumerate(cameras.values()):
            figures["time_offset_frames"] = step.offset[index]
            figures["time_offset_error_frames"] = step.error[index]
            figures["out_of_step"] = bool(step.is_out[index])
    for own, figures in zip(calibration.looked_through, cameras.values(), strict=False):
        figures["looked_through"] = list(own)
    windows = {window.name: window.figures() for window in calibration.windows}
    figures = {
        "method": "target images, joint adjustment of lenses, camera poses and target poses",
        "rms_px": np.sqrt((calibration.residuals[used] ** 2).sum(axis=1).mean()),
        "noise_px": calibration.noise,
        "frames": int(np.isfinite(quality.frame_rms).sum()),
        "points_used": int(used.sum()),
        "points_left_out": int((~used).sum()),
        "held": calibration.gauge,
        "length_unit": calibration.rig.length_unit,
        "ray_miss_predicted": quality.predicted_ray_miss,
        "ray_miss_between_halves": quality.cross_ray_miss,
        "ray_miss_between_halves_expected": quality.cross_expected,
        "pixel_footprint": np.nanmedian(quality.footprint),
        "findings": list(calibration.findings),
        "assessment": calibration.assessment,
        "cameras": cameras,
        **({"windows": windows} if windows else {}),
        "target_poses": _target_poses(calibration),
    }
    return plain(figures, _DIGITS)


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
            poses.append({"frame": frame, "camera": camera.name, "corners": corners.tolist()})
    return poses
