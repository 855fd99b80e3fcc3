"""The result of a refinement: cameras before and after, and whether they were accepted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.selfcal.refine.parameters import FOCAL, GAIN


@dataclass(frozen=True, eq=False)
class Refinement:
    """The result of a refinement.

    Attributes
    ----------
    given, found : Rig
        The rig before and after the refinement; `rig` is the one to use.
    cameras : tuple of str
        Names of the refined cameras; the others are as given.
    parameters : (cameras of the rig, 8) float64
        See `tomo.selfcal.refine.parameters`; zero for cameras that were not refined.
    prior_pixels : (cameras of the rig,) float64
        Standard deviation of the prior of each parameter, in pixels.
    moved_pixels : (cameras of the rig,) float64
        RMS motion of the volume's points in each image.
    error_before, error_after : float
        Relative error of held-out rays, predicted from other views.
    rounds : tuple of float
        The same error after each round.
    accepted : bool
        Whether the refined rig is to be used.
    reason : str
        Why the refined rig was accepted or not, as a sentence.
    """

    given: Rig
    found: Rig
    cameras: tuple[str, ...]
    parameters: NDArray[np.float64]
    prior_pixels: NDArray[np.float64]
    moved_pixels: NDArray[np.float64]
    error_before: float
    error_after: float
    rounds: tuple[float, ...]
    accepted: bool
    reason: str

    @property
    def rig(self) -> Rig:
        """The rig to use: the refined one if it was accepted, else the given one."""
        return self.found if self.accepted else self.given

    def __repr__(self) -> str:
        """Name the outcome."""
        return (
            f"<Refinement: {len(self.cameras)} of {len(self.given)} cameras, held-out rays "
            f"{self.error_before:.4f} to {self.error_after:.4f}, accepted {self.accepted}>"
        )

    def report(self) -> dict[str, Any]:
        """Return the entries of the report: plain numbers and words."""
        cameras = {}
        for index, camera in enumerate(self.given):
            if camera.name not in self.cameras:
                continue
            own = self.parameters[index]
            cameras[camera.name] = {
                "prior_pixels": float(self.prior_pixels[index]),
                "moved_pixels": float(self.moved_pixels[index]),
                "position_right_down_forward": own[:3].tolist(),
                "turn_degrees": np.degrees(own[3:6]).tolist(),
                "focal_length_ratio": math.exp(own[FOCAL]),
                "gain": math.exp(own[GAIN]),
            }
        return {
            "accepted": self.accepted,
            "reason": self.reason,
            "held_out_error_before": self.error_before,
            "held_out_error_after": self.error_after,
            "held_out_error_by_round": list(self.rounds),
            "cameras": cameras,
        }
