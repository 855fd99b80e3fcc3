"""Small pointing errors of cameras, corrected by a shift of each image.

A pointing error of half a pixel costs more than any choice of method: the views contradict each
other, and the volume is blurred where they do. Each left-out view is predicted from the other
views and registered with its image; the shift found is the camera's pointing error relative to
the others. A camera turned by so small an angle records its image shifted as a whole, which is
the same as a shift of its principal point. A motion common to all cameras is a motion of the
volume and is subtracted.

Only the images are used. The cameras stay as they are unless the shifts clearly improve the
prediction of left-out views.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig, image_motion
from tomo.grid import VoxelGrid
from tomo.operators import choose_form
from tomo.operators.system import VolumeNotSeenError
from tomo.scan.downsample import Coarser, coarsening
from tomo.selfcal.left_out_views import Carved, Evaluated, Round, shifted
from tomo.selfcal.residual_shift import Displacement

SEGMENTS = 2_000_000
"""Approximate segments of the coarser system on which the shifts are found. More take longer;
fewer leave pixels too coarse for shifts of half a pixel."""

ROUNDS = 2
"""Corrections of the shifts at most: one leaves errors that a second removes; more take longer."""

STEP_FRACTION = 0.8
"""Fraction of the shifts found that is applied in a round. All views move at once, so that 1
overshoots; a small fraction needs more rounds."""

WORTH_IT = 0.8
"""Largest ratio of the squared errors of left-out views, with shifts over without, at which shifts
are accepted. Higher, noise moves exact cameras; lower, real pointing errors stay."""

LARGEST_SHIFT = 0.1
"""Largest accepted shift, as a fraction of the image's shorter side. Higher, a wrong match may be
accepted; lower, good corrections of large pointing errors are refused."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """The shifts of the cameras' images relative to the rig.

    Attributes
    ----------
    shifts : (views, 2) float64
        Right and down in pixels, from where the rig projects a point to where it is recorded.
    error_before, error_after : float
        Relative error of left-out views, without and with the shifts.
    accepted : bool
        Whether the shifts are to be applied.
    reason : str
        Why the shifts were accepted or not, as a sentence.
    evaluated : optional
        The data from which `displacement` is computed.
    """

    shifts: NDArray[np.float64]
    error_before: float
    error_after: float
    accepted: bool
    reason: str
    evaluated: Evaluated | None = None

    @cached_property
    def displacement(self) -> Displacement | None:
        """The displacements that remain with the accepted shifts, if any were accepted.

        None where nothing could be predicted. It is computed when it is first read, because no
        volume needs it and it may take longer than the shifts.
        """
        return None if self.evaluated is None else self.evaluated.displacement()

    def rig(self, rig: Rig) -> Rig:
        """Return the rig with shifted principal points, or unchanged if not accepted."""
        if not self.accepted:
            return rig
        return shifted(rig, self.shifts)

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the entries of the report as plain numbers, by the cameras' ``names``."""
        return {
            "shifts": dict(zip(names, self.shifts.tolist(), strict=True)),
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
    """Find the shift of every view relative to the other views.

    Parameters
    ----------
    rig : Rig
    images : sequence of (height, width)
        One image a camera, of the cameras that the reconstruction uses; held-out views excluded.
    grid : VoxelGrid
    masks : sequence of (height, width) bool, optional
        True where a pixel is usable.

    Raises
    ------
    ValueError
        If the number of images is not the number of cameras.
    """
    if len(images) != len(rig):
        raise ValueError(f"images: found {len(images)}, expected one for each of {len(rig)}")
    masks = [np.isfinite(image) for image in images] if masks is None else list(masks)
    zero_shifts = np.zeros((len(rig), 2))
    if len(rig) < 3:
        return _not_accepted(zero_shifts, "too few views: leaving one out takes at least 3")
    coarse = Coarser.of(rig, images, masks, grid, coarsening(rig, grid, SEGMENTS))
    choose_form(tuple(coarse.rig), coarse.grid)  # raises before carving where memory is too small
    motions = [_motion(camera, grid) for camera in coarse.rig]

    shifts, rounds = [zero_shifts], []
    for _ in range(ROUNDS + 1):
        try:
            found = Round.of(coarse, Carved.of(coarse, shifts[-1]))
        except VolumeNotSeenError:
            return _not_accepted(zero_shifts, "the cameras do not see the volume")
        if not math.isfinite(found.error):
            return _not_accepted(zero_shifts, "the images are dark")
        rounds.append(found)
        if found.registered**2 > WORTH_IT * found.error**2 and len(rounds) == 1:
            break
        shifts.append(_without_common_motion(shifts[-1] + STEP_FRACTION * found.shifts, motions))
    errors = [found.error for found in rounds]
    first, best = rounds[0], int(np.argmin(errors))
    before, after = first.error, errors[best]
    limits = [LARGEST_SHIFT * min(camera.image_size) for camera in coarse.rig]
    if len(rounds) == 1:
        after, reason = first.registered, "left-out views lie where the other views predict them"
    elif after**2 > WORTH_IT * before**2:
        reason = "shifts do not clearly improve the prediction of left-out views"
    elif (np.abs(shifts[best]).max(axis=1) > limits).any():
        reason = "the shifts found are too large for pointing errors"
    else:
        reason = f"the relative error of left-out views falls from {before:.3f} to {after:.3f}"
        evaluated = Evaluated(rounds[best], coarse, shifts[best])
        return Alignment(shifts[best] * coarse.factor, before, after, True, reason, evaluated)
    evaluated = Evaluated(first, coarse, zero_shifts)
    return Alignment(zero_shifts, before, after, False, reason, evaluated)


def _not_accepted(shifts: NDArray, reason: str) -> Alignment:
    return Alignment(shifts, math.nan, math.nan, False, reason)


def _motion(camera: CameraLike, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the derivative of the image of the grid's centre by a world motion: ``(2, 3)``."""
    step = 1e-3 * float(np.min(np.asarray(grid.shape) * grid.spacing))
    center = np.tile(grid.center, (3, 1))
    return np.nan_to_num(image_motion(camera, center, step * np.eye(3)).T / step)


def _without_common_motion(
    shifts: NDArray[np.float64], motions: Sequence[NDArray]
) -> NDArray[np.float64]:
    """Subtract the shifts of the volume's best-fitting motion: ``(views, 2)``."""
    stacked = np.concatenate(motions)  # (2 views, 3)
    motion = np.linalg.lstsq(stacked, shifts.ravel(), rcond=None)[0]
    return shifts - (stacked @ motion).reshape(shifts.shape)
