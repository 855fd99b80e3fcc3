"""Cameras that were moved, for the asking or because images contradict them, and what is said."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rigs import Rig, box_points
from rigs.scene.scene_camera import own_camera
from tomo.grid import VoxelGrid
from tomo.inference.left_out import LeftOut
from tomo.model import Observation, Pose
from tomo.model.pose import LATTICE, stated_errors
from tomo.scan import Scan


@dataclass(frozen=True, eq=False)
class Refinement:
    """What was found of cameras."""

    given: Rig  # those that take part, before
    rig: Rig  # and after
    cameras: tuple[str, ...]  # asked for, or contradicted by images
    asked: bool
    grid: VoxelGrid
    priors: Mapping[str, float]  # standard deviation of each camera, in pixels
    gains: Mapping[str, float]
    left_out: LeftOut | None = None  # how left-out pixels judge what was asked for

    @property
    def accepted(self) -> bool:
        """Whether any camera was moved."""
        return tuple(self.rig) != tuple(self.given)

    @property
    def reason(self) -> str:
        """Why they were moved, or were not."""
        one = self.left_out
        if one is not None and one.is_better:
            before, after = one.relative_errors
            return f"the relative error of left-out pixels falls from {before:.4f} to {after:.4f}"
        if self.accepted:
            return "images contradict where the rig says they are"
        if one is None:
            return "the images show too little light"
        return (
            "refined cameras do not improve the prediction of left-out pixels, whose "
            f"relative error is {one.relative_errors[0]:.4f}"
        )

    def sentence(self, frames: int) -> str:
        """Return what was found of the cameras, from so many frames, and what to do."""
        names = ", ".join(self.cameras)
        if not self.accepted:
            return (
                f"cameras stay as the rig says: {names}: {self.reason}. Leave --refine-cameras "
                "out, or name other cameras"
            )
        moved = {name: self._moved(name) for name in self.cameras}
        farthest = max(moved, key=lambda name: np.nan_to_num(moved[name]))
        where, then = "the images", "Use refined_rig.yaml for further frames"
        if frames > 1:
            where, then = f"{frames} frames together", "They are the store's corrected_rig"
        return (
            f"cameras refined from {where}: {names}: {self.reason}; {farthest} moves farthest, by "
            f"{moved[farthest]:.1f} pixels. {then}"
        )

    def report(self) -> dict[str, Any]:
        """Return the entries of the report: plain numbers and words."""
        errors = (None, None) if self.left_out is None else self.left_out.relative_errors
        return {
            "asked": self.asked,
            "accepted": self.accepted,
            "reason": self.reason,
            "held_out_error_before": errors[0],
            "held_out_error_after": errors[1],
            "cameras": {name: self._report(name) for name in self.cameras},
        }

    def recorded_rig(self, scan: Scan) -> Rig | None:
        """Return the scan's rig as recorded, its cameras as they were found; None if as given."""
        if not self.accepted:
            return None
        both = (self.rig[c.name] if c.name in self.rig.names else c for c in scan.rig)
        known = {**(scan.rig.calibration or {}), "refined_from_images": self.report()}
        cameras = tuple(scan.recorded_camera(camera) for camera in both)
        return replace(scan.rig, cameras=cameras, calibration=known)

    def _report(self, name: str) -> dict[str, Any]:
        given, found = (own_camera(rig[name]) for rig in (self.given, self.rig))
        before, after = given.camera_matrix, found.camera_matrix
        way = found.position - given.position
        turn = Rotation.from_matrix(found.R @ given.R.T).as_rotvec(degrees=True)
        return {
            "prior_pixels": self.priors[name],
            "moved_pixels": self._moved(name),
            "shift_pixels": (after[:2, 2] - before[:2, 2]).tolist(),
            "position_right_down_forward": (given.R @ way).tolist(),
            "turn_degrees": turn.tolist(),
            "focal_length_ratio": float(after[0, 0] / before[0, 0]),
            "gain": self.gains.get(name, 1.0),
        }

    def _moved(self, name: str) -> float:
        """Return how far the images of points of the grid moved, root mean square, in pixels."""
        points = box_points(self.grid.lower, self.grid.upper, LATTICE)
        (here, _, seen), (there, _, too) = (
            rig[name].project(points) for rig in (self.given, self.rig)
        )
        apart = np.sum(np.square(there - here), axis=1)[seen & too]
        return float(np.sqrt(np.mean(apart))) if len(apart) else math.nan


def priors_of(cameras: Sequence[str], observation: Observation) -> dict[str, float]:
    """Return how far each pose asked for may be off, in pixels: by mounts and the rig."""
    if not cameras:
        return {}
    stated = np.sqrt(np.square(stated_errors(observation.rig, observation.grid)).mean(axis=1))
    own = dict(zip(observation.rig.names, np.hypot(stated, Pose.sigma).tolist(), strict=True))
    return {name: own[name] for name in cameras}
