"""The input of a refinement (images, cameras, priors) and the result built from its parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Rig, box_points
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull import carve
from tomo.scan.downsample import Coarser
from tomo.selfcal.refine.held_out import (
    SIGNIFICANT,
    SURE_ELSEWHERE,
    HeldOutErrors,
    training_pixels,
)
from tomo.selfcal.refine.moment import Moment
from tomo.selfcal.refine.parameters import COUNT, GEOMETRY, moved_rig
from tomo.selfcal.refine.prior import GAIN_PRIOR, units
from tomo.selfcal.refine.refinement import Refinement
from tomo.selfcal.refine.resolution_level import Level


@dataclass(frozen=True, eq=False)
class Task:
    """The input of a refinement.

    Attributes
    ----------
    rig : Rig
    moments : tuple of Moment
        Those that the cameras are refined from, each with a volume of its own.
    judges : tuple of Moment
        Those whose held-out rays decide: others, or the same where there are no others.
    grid : VoxelGrid
    chosen : tuple of int
        Indices of the cameras to refine.
    prior_pixels : (cameras,) float64
        Standard deviations of the priors in pixels.
    skip : bool
        Whether to carve away voxels that dark pixels show to be empty.
    """

    rig: Rig
    moments: tuple[Moment, ...]
    judges: tuple[Moment, ...]
    grid: VoxelGrid
    chosen: tuple[int, ...]
    prior_pixels: NDArray[np.float64]
    skip: bool

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Standard deviations of the priors of all parameters, ``(cameras, 8)``."""
        rows = []
        for camera, pixels in zip(self.rig, self.prior_pixels, strict=True):
            sizes = np.r_[np.full(GEOMETRY, pixels), GAIN_PRIOR]
            rows.append(sizes * units(camera, self.grid))
        return np.array(rows)

    def level(self, factor: int) -> Level:
        """Return the problem with pixels and voxels ``factor`` times as coarse."""
        first = self.moments[0]
        coarse = Coarser.of(self.rig, first.images, first.masks, self.grid, factor)
        moments, judges = (
            tuple(one.coarser(self.rig, self.grid, factor) for one in some)
            for some in (self.moments, self.judges)
        )
        active = ActiveVoxels(coarse.grid)
        if self.skip:
            lit = [_hull(coarse.rig, one, coarse.grid) for one in (*moments, *judges)]
            active = ActiveVoxels.from_mask(coarse.grid, np.logical_or.reduce(lit))
        return Level(coarse.rig, moments, judges, coarse.grid, active, self.chosen, self.lengths)

    def size(self, step: NDArray[np.float64]) -> float:
        """Return the motion of the volume's image by a step, in pixels, RMS over the cameras."""
        moves = _moves(self.rig, moved_rig(self.rig, step), self.grid)[list(self.chosen)]
        return float(np.sqrt(np.mean(np.square(moves))))

    def result(
        self,
        parameters: NDArray[np.float64],
        before: HeldOutErrors,
        after: HeldOutErrors,
        errors_by_round: Sequence[float],
    ) -> Refinement:
        """Return the refinement with the best parameters found."""
        errors = before.relative_error, after.relative_error
        elsewhere = self.judges != self.moments
        moved = 0.0 if elsewhere else len(self.chosen) / len(self.rig)
        sure = SURE_ELSEWHERE if elsewhere else SIGNIFICANT
        accepted = bool(parameters.any()) and before.is_improved_by(after, moved, sure)
        reason = (
            f"the relative error of held-out rays falls from {errors[0]:.4f} to {errors[1]:.4f}"
            if accepted
            else "refined cameras do not clearly improve the prediction of held-out rays, whose "
            f"relative error is {errors[0]:.4f}"
        )
        found = moved_rig(self.rig, parameters)
        moves = _moves(self.rig, found, self.grid)
        return self._refinement(
            found, parameters, moves, *errors, errors_by_round, accepted, reason
        )

    def unchanged(self, reason: str) -> Refinement:
        """Return a refinement that leaves all cameras as given."""
        zeros = np.zeros((len(self.rig), COUNT))
        zero = np.zeros(len(self.rig))
        return self._refinement(
            self.rig, zeros, zero, math.nan, math.nan, (), accepted=False, reason=reason
        )

    def _refinement(
        self, found, parameters, moves, before, after, errors_by_round, accepted, reason
    ) -> Refinement:
        return Refinement(
            self.rig,
            found,
            tuple(self.rig.names[view] for view in self.chosen),
            parameters,
            self.prior_pixels,
            moves,
            before,
            after,
            tuple(errors_by_round),
            accepted,
            reason,
        )


def _hull(rig: Rig, moment: Moment, grid: VoxelGrid) -> NDArray[np.bool_]:
    """Return which voxels may be lit, as the rays that are not held out show."""
    training = training_pixels([moment])
    return carve(tuple(rig), moment.images, training, grid).active.mask


def _moves(rig: Rig, other: Rig, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the RMS motion in pixels of the volume's points in each image, ``(cameras,)``."""
    points, moves = box_points(grid.lower, grid.upper, 5), []
    for camera, changed in zip(rig, other, strict=True):
        (here, _, valid), (there, _, also_valid) = camera.project(points), changed.project(points)
        apart = np.sum(np.square(there - here), axis=1)[valid & also_valid]
        moves.append(float(np.sqrt(np.mean(apart))) if len(apart) else math.nan)
    return np.array(moves)
