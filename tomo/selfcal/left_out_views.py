"""Views predicted from the other views, and how far they lie from where they are predicted.

How far views lie off with exact cameras is simulated. Two volumes stand for all that is no error
of the cameras: one in the grid, and one in a larger box, for light from outside the grid. Each
explains all images as well as it can, is seen by the cameras as the rig has them, with new noise,
and its views are then predicted in the grid like the recorded ones. Cameras are wrong only where
the recorded views lie farther off than both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull import carve
from tomo.measurement import estimate_noise
from tomo.operators import LinearSystem
from tomo.operators.system import VolumeNotSeenError
from tomo.scan.downsample import Coarser
from tomo.selfcal.registration import register, shift_motions
from tomo.selfcal.residual_shift import Displacement
from tomo.solvers.initial_volume import log_back_projections
from tomo.solvers.quick_volume import quick_volume

ITERATIONS = 2
"""Iterations of each quick volume: more take longer and fit the wrong shifts."""

GROUPS = 4
"""Interleaved groups in which more than six views are left out; up to six are left out singly.
More groups take longer; fewer predict each view from too few others."""

EXPLAINING = 20
"""Iterations of a volume that explains images. Fewer leave it so smooth that all views disagree
with it; its noise and light from outside the grid then move its views less than recorded ones."""

ROOM = 0.5
"""Fraction of the grid's edges that the larger box adds on each side. Less leaves light out that
cameras see beside the grid, more takes longer."""


@dataclass(frozen=True, eq=False)
class Carved:
    """The equations of the voxels that dark pixels leave, and their pixels.

    Attributes
    ----------
    system : LinearSystem
    measured : (pixels,) float32
    """

    system: LinearSystem
    measured: NDArray[np.float32]

    @classmethod
    def of(
        cls, coarse: Coarser, shifts: NDArray[np.float64], box: VoxelGrid | None = None
    ) -> Self:
        """Return those of shifted cameras, in the grid or in a larger ``box``.

        Voxels beside the grid are those that all cameras see: one that few see explains whatever
        is wrong with these.

        Raises
        ------
        tomo.operators.system.VolumeNotSeenError
            If no usable pixel sees the grid.
        """
        rig = shifted(coarse.rig, shifts)
        grid = box or coarse.grid
        found = carve(tuple(rig), coarse.images, coarse.masks, grid)
        active = found.active
        if box is not None:
            active = ActiveVoxels.from_mask(box, active.mask & _seen_by_all(rig, box))
        system = LinearSystem.from_rig(rig, grid, masks=found.pixels, active=active)
        return cls(system, system.flatten(coarse.images))

    def explained(self) -> list[NDArray[np.float32]]:
        """Return all images as one volume explains them."""
        projector = self.system.projector
        views = range(projector.n_views)
        volume = quick_volume(projector, self.measured, views, iterations=EXPLAINING)
        return self.system.images((projector @ volume).astype(np.float32))


@dataclass(frozen=True, eq=False)
class Round:
    """One round: every left-out view predicted and registered with its image.

    Attributes
    ----------
    shifts : (views, 2) float64
        The shift of every view relative to the other views, in pixels of the coarse images.
    error, registered : float
        Relative errors of the predictions before and after registration.
    predicted : tuple of (rows, columns) float32
    """

    shifts: NDArray[np.float64]
    error: float
    registered: float
    predicted: tuple[NDArray[np.float32], ...]

    @classmethod
    def of(cls, coarse: Coarser, carved: Carved) -> Self:
        """Predict all views, from their images and the equations that they were carved to."""
        images, masks = coarse.images, coarse.masks
        system, measured = carved.system, carved.measured
        views = range(len(images))
        count = len(views) if len(views) <= 6 else GROUPS
        shifts_found, predicted = np.zeros((len(views), 2)), {}
        back_projections = log_back_projections(system.projector, measured)
        unregistered = registered = light = 0.0
        for group in range(count):
            left_out = list(views[group::count])
            kept = [view for view in views if view not in left_out]
            volume = quick_volume(
                system.projector,
                measured,
                kept,
                iterations=ITERATIONS,
                back_projections=back_projections,
            )
            reprojected = system.images(system.projector @ volume)
            for view in left_out:
                image, mask, predicted[view] = images[view], masks[view], reprojected[view]
                found = register(reprojected[view], image, mask, shift_motions(image.shape))
                shifts_found[view] = found.amounts
                unregistered += found.before
                registered += found.after
                light += float(np.sum(np.square(image, dtype=np.float64)[mask]))
        all_predicted = tuple(predicted[view] for view in views)
        if light == 0:
            return cls(shifts_found, math.nan, math.nan, all_predicted)
        return cls(
            shifts_found,
            math.sqrt(unregistered / light),
            math.sqrt(registered / light),
            all_predicted,
        )

    def displacement(self, coarse: Coarser) -> Displacement:
        """Return how far the images lie from the predictions."""
        return Displacement.of(self.predicted, coarse.images, coarse.masks, coarse.factor)


@dataclass(frozen=True, eq=False)
class Evaluated:
    """The round at the final shifts, and the coarse images that it compared.

    Attributes
    ----------
    round : Round
    coarse : Coarser
    shifts : (views, 2) float64
    """

    round: Round
    coarse: Coarser
    shifts: NDArray[np.float64]

    def displacement(self) -> Displacement:
        """Return the round's displacements; where they are large, with those of exact cameras."""
        found = self.round.displacement(self.coarse)
        exact = np.zeros(len(self.coarse.rig))
        for box in (None, larger_box(self.coarse.grid)):
            if not found.disagrees:
                break
            try:
                exact = np.maximum(exact, self._with_exact_cameras(box).pixels)
            except VolumeNotSeenError:  # an empty volume predicts nothing
                break
            found = replace(found, exact_cameras=exact)
        return found

    def _with_exact_cameras(self, box: VoxelGrid | None) -> Displacement:
        """Return the displacements of views of a volume in a box, predicted like the images."""
        coarse = self.coarse
        # traced again to save memory in between
        seen = Carved.of(coarse, self.shifts, box).explained()
        noise = map(estimate_noise, coarse.images, coarse.masks)
        variances = [one.variance(image) for one, image in zip(noise, seen, strict=True)]
        simulated = replace(coarse, images=recorded(seen, coarse.masks, variances))
        system = Carved.of(coarse, self.shifts).system
        again = Round.of(simulated, Carved(system, system.flatten(simulated.images)))
        return again.displacement(simulated)


def shifted(rig: Rig, shifts: NDArray[np.float64]) -> Rig:
    """Return the rig with principal points shifted by ``(views, 2)`` pixels."""
    moved = (camera.shifted(*shift) for camera, shift in zip(rig, shifts, strict=True))
    return replace(rig, cameras=tuple(moved))


def _seen_by_all(rig: Rig, grid: VoxelGrid) -> NDArray[np.bool_]:
    """Return the voxels whose centres lie in all images, ``(nx, ny, nz)``."""
    seen, points = np.ones(grid.size, bool), grid.centers().reshape(-1, 3)
    for camera in rig:
        at, _, valid = camera.project(points)
        seen &= (
            valid & (at >= 0).all(axis=1) & (at <= np.asarray(camera.image_size) - 1).all(axis=1)
        )
    return seen.reshape(grid.shape)


def recorded(
    seen: Iterable[NDArray[np.floating]],
    masks: Iterable[NDArray[np.bool_]],
    variances: Iterable[NDArray[np.floating]],
) -> tuple[NDArray[np.float32], ...]:
    """Return images ``(rows, columns)`` with new noise of a variance, 0 where not usable.

    The same images get the same noise.
    """
    random, found = np.random.default_rng(0), []
    for image, mask, variance in zip(seen, masks, variances, strict=True):
        made = image + np.sqrt(variance) * random.standard_normal(image.shape)
        found.append(np.where(mask, made, 0).astype(np.float32))
    return tuple(found)


def larger_box(grid: VoxelGrid, finer: float = 1.0) -> VoxelGrid:
    """Return a grid of the larger box, with voxels about ``finer`` times as wide."""
    room = ROOM * grid.extent
    shape = [max(round((1 + 2 * ROOM) * n / finer), 1) for n in grid.shape]
    return VoxelGrid.from_bounds(shape, grid.lower - room, grid.upper + room)
