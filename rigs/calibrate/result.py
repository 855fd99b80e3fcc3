"""A calibrated rig with the figures that say how far it can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.observations import Observations
from rigs.calibrate.quality.quality import Quality
from rigs.rig import Rig


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """A calibrated rig and all that says how far it can be trusted.

    Parameters
    ----------
    rig : Rig
        ``rig.calibration`` holds the figures as plain data.
    observations : Observations
        What it was made from.
    residuals : (sightings, 2) float64
        Measured less projected, pixels; NaN where the frame has no pose.
    used : (sightings,) bool
        False where a sighting was left out: culled, a repeated image, or in a frame without pose.
    target_R, target_t : (frames, 3, 3), (frames, 3) float64
        ``x_world = R x_target + t``; NaN where a frame has no pose.
    terms : tuple of str
        Each camera's lens terms: a name of those of `calibrate`, or "given".
    noise : float
        Standard deviation of a pixel coordinate, from the residuals used.
    parameters : tuple of (str, str)
        Camera and name of each adjusted number: wx wy wz (rotation vector multiplied from the
        left, radians), tx ty tz (length units), fx fy cx cy (pixels), c0 c1 ... (coefficients).
    covariance : (parameters, parameters) float64
        Of these, while the pose of camera ``gauge`` is held.
    gauge : str
    quality : Quality
    findings : tuple of str
        What is wrong and then what was merely left out, a line each: cameras and frames by name.
    verdict : str
        The figure that counts, what it means, then the findings.
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
    verdict: str

    def __repr__(self) -> str:
        rms = np.sqrt((self.residuals[self.used] ** 2).sum(axis=1).mean())
        return (
            f"<Calibration: {len(self.rig)} cameras, {int(self.used.sum())} of {len(self.used)} "
            f"sightings, RMS {rms:.3g} px>"
        )
