"""Cameras that look a little beside where they are said to look: a shift of each image.

Half a pixel of error in where a camera points costs more than any choice of method: the views
contradict each other, and what they cannot agree on is smeared out. A view left out is predicted
from the others, and registered with its image: the shift that it takes is the camera's error
against theirs. Turned by so little, a camera sees its image shifted as a whole, which is a shift
of its principal point. A common motion of all the cameras is one of the volume and is taken out.

Nothing but the images takes part; when the shifts do not clearly improve the prediction of views
left out, the cameras stay as they are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig, image_motion
from tomo._compute.by_camera import by_name
from tomo.grid import VoxelGrid
from tomo.hull import carve
from tomo.operators import LinearSystem, choose_form
from tomo.operators.system import VolumeNotSeenError
from tomo.scan.downsample import Coarser, coarsening
from tomo.selfcal.registration import register, ways_to_shift
from tomo.selfcal.residual_shift import Displacement
from tomo.solvers.initial_volume import log_back_projections
from tomo.solvers.quick_volume import quick_volume

CROSSINGS = 2_000_000
"""About the size of the coarser system that the shifts are found on."""

ROUNDS = 2
ITERATIONS = 2
STEP = 0.8
"""Share of the shifts found that is made each round: all views move at once."""

GROUPS = 4
"""Up to six views are left out one at a time, more in so many interleaved groups."""

WORTH_IT = 0.8
"""Share of the squared error of views left out that shifts must leave at most to be believed."""

FARTHEST = 0.1
"""Of an image's shorter side: a camera farther off is not merely a little off. Half as much
refused shifts after which views left out were predicted as well as by the right rig."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """How the cameras' images are shifted against what the rig says.

    Attributes
    ----------
    shifts : (views, 2) float64
        Right and down, in pixels: a point appears so far from where the rig says.
    error_before, error_after : float
        Relative error of views left out, without the shifts and with them.
    accepted : bool
        Whether the shifts are worth making.
    reason : str
        In words.
    judged : optional
        What says how far views lie from where the others predict them, see `displacement`.
    """

    shifts: NDArray[np.float64]
    error_before: float
    error_after: float
    accepted: bool
    reason: str
    judged: _Judged | None = None

    @cached_property
    def displacement(self) -> Displacement | None:
        """How far views lie from where the others predict them, with shifts that were accepted.

        None where nothing could be predicted. Found when it is first asked for: no volume needs
        it, and where views lie far off it takes longer than the shifts.
        """
        return None if self.judged is None else self.judged.displacement()

    def rig(self, rig: Rig) -> Rig:
        """Return the rig with its principal points shifted; as it is if not accepted."""
        if not self.accepted:
            return rig
        return _shifted(rig, self.shifts)

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Return what a report says of it: plain numbers and words; ``names`` are the cameras'."""
        return {
            "shifts": by_name(names, self.shifts),
            "error_before": self.error_before,
            "error_after": self.error_after,
            "accepted": self.accepted,
            "reason": self.reason,
            "displacement": self.displacement.report(names) if self.displacement else None,
        }


def align_views(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    grid: VoxelGrid,
    *,
    masks: Sequence[NDArray[np.bool_]] | None = None,
) -> Alignment:
    """Find the shift of every view against the others.

    Parameters
    ----------
    rig : Rig
    images : sequence of (height, width)
        One a camera: only those that the reconstruction may use.
    grid : VoxelGrid
    masks : sequence of (height, width) bool, optional
        True where a pixel is usable.

    Raises
    ------
    ValueError
        If there are not as many images as cameras.
    """
    if len(images) != len(rig):
        raise ValueError(f"images: found {len(images)}, expected one for each of {len(rig)}")
    masks = [np.isfinite(image) for image in images] if masks is None else list(masks)
    still = np.zeros((len(rig), 2))
    if len(rig) < 3:
        return _refused(still, math.nan, math.nan, "too few views to leave any out")
    coarse = Coarser.of(rig, images, masks, grid, coarsening(rig, grid, CROSSINGS))
    choose_form(tuple(coarse.rig), coarse.grid)  # refuses what would not fit: carving does not
    motions = [_motion(camera, grid) for camera in coarse.rig]

    shifts, rounds = [still], []
    for _ in range(ROUNDS + 1):
        try:
            found = _Round.of(coarse, shifts[-1])
        except VolumeNotSeenError:
            return _refused(still, math.nan, math.nan, "the cameras do not see the volume")
        if not math.isfinite(found.error):
            return _refused(still, math.nan, math.nan, "the images are dark")
        rounds.append(found)
        if found.registered**2 > WORTH_IT * found.error**2 and len(rounds) == 1:
            break
        shifts.append(_without_common_motion(shifts[-1] + STEP * found.shifts, motions))
    errors = [one.error for one in rounds]
    as_it_is, best = rounds[0], int(np.argmin(errors))
    before, after = as_it_is.error, errors[best]
    limits = [FARTHEST * min(camera.image_size) for camera in coarse.rig]
    if len(rounds) == 1:
        after, reason = as_it_is.registered, "views left out lie where they are predicted"
    elif after**2 > WORTH_IT * before**2:
        reason = "shifts hardly improve the views left out"
    elif (np.abs(shifts[best]).max(axis=1) > limits).any():
        reason = "the shifts found are too large to be believed"
    else:
        reason = f"views left out are predicted to {after:.3f} instead of {before:.3f}"
        judged = _Judged(rounds[best], coarse, shifts[best])
        return Alignment(shifts[best] * coarse.factor, before, after, True, reason, judged)
    judged = _Judged(as_it_is, coarse, still)
    return Alignment(still, before, after, False, reason, judged)


def _refused(shifts: NDArray, before: float, after: float, reason: str) -> Alignment:
    return Alignment(shifts, before, after, False, reason)


@dataclass(frozen=True, eq=False)
class _Round:
    """What the views left out say of the cameras as they are.

    Attributes
    ----------
    shifts : (views, 2) float64
        Of every view against the others.
    error, registered : float
        Relative errors of the predictions as they are, and as registration makes them.
    predicted : tuple of (rows, columns) float32
    """

    shifts: NDArray[np.float64]
    error: float
    registered: float
    predicted: tuple[NDArray[np.float32], ...]

    @classmethod
    def of(cls, coarse: Coarser, shifts: NDArray[np.float64]) -> Self:
        images, masks = coarse.images, coarse.masks
        system, measured = _seen(coarse, shifts)
        views = range(len(images))
        count = len(views) if len(views) <= 6 else GROUPS
        further, predicted = np.zeros((len(views), 2)), {}
        back_projections = log_back_projections(system.projector, measured)
        raw = registered = light = 0.0
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
            seen = system.images(system.projector @ volume)
            for view in left_out:
                image, mask, predicted[view] = images[view], masks[view], seen[view]
                found = register(seen[view], image, mask, ways_to_shift(image.shape))
                further[view] = found.amounts
                raw += found.before
                registered += found.after
                light += float(np.sum(np.square(image, dtype=np.float64)[mask]))
        every = tuple(predicted[view] for view in views)
        if light == 0:
            return cls(further, math.nan, math.nan, every)
        return cls(further, math.sqrt(raw / light), math.sqrt(registered / light), every)

    def displacement(self, coarse: Coarser) -> Displacement:
        return Displacement.of(self.predicted, coarse.images, coarse.masks, coarse.factor)


@dataclass(frozen=True, eq=False)
class _Judged:
    """A round at the shifts ``(views, 2)`` that stay, and the images that it was of."""

    round: _Round
    coarse: Coarser
    shifts: NDArray[np.float64]

    def displacement(self) -> Displacement:
        """Return that of the round; where it is large, with what exact cameras would show."""
        found = self.round.displacement(self.coarse)
        if not found.disagrees:
            return found
        system, measured = _seen(self.coarse, self.shifts)  # not kept while a volume is solved for
        views = range(len(self.coarse.rig))
        volume = quick_volume(system.projector, measured, views, iterations=2 * ITERATIONS)
        seen = system.images((system.projector @ volume).astype(np.float32))
        bootstrapped = replace(self.coarse, images=tuple(seen))
        try:
            of_exact = _Round.of(bootstrapped, self.shifts).displacement(bootstrapped)
        except VolumeNotSeenError:  # an empty volume says nothing of the cameras
            return found
        return replace(found, of_exact=of_exact.pixels)


def _seen(
    coarse: Coarser, shifts: NDArray[np.float64]
) -> tuple[LinearSystem, NDArray[np.float32]]:
    """Return what shifted cameras see of voxels that may emit, and their pixels ``(pixels,)``."""
    rig = _shifted(coarse.rig, shifts)
    found = carve(tuple(rig), coarse.images, coarse.masks, coarse.grid)
    system = LinearSystem.from_rig(rig, coarse.grid, masks=found.pixels, active=found.active)
    return system, system.flatten(coarse.images)


def _motion(camera: CameraLike, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return how far the image of the grid's middle moves as the world does: ``(2, 3)``."""
    step = 1e-3 * float(np.min(np.asarray(grid.shape) * grid.spacing))
    middle = np.tile(grid.center, (3, 1))
    return np.nan_to_num(image_motion(camera, middle, step * np.eye(3)).T / step)


def _without_common_motion(
    shifts: NDArray[np.float64], motions: Sequence[NDArray]
) -> NDArray[np.float64]:
    """Return the shifts less those of the one motion of the volume that explains most of them."""
    stacked = np.concatenate(motions)  # (2 views, 3)
    motion = np.linalg.lstsq(stacked, shifts.ravel(), rcond=None)[0]
    return shifts - (stacked @ motion).reshape(shifts.shape)


def _shifted(rig: Rig, shifts: NDArray[np.float64]) -> Rig:
    moved = (camera.shifted(*shift) for camera, shift in zip(rig, shifts, strict=True))
    return replace(rig, cameras=tuple(moved))
