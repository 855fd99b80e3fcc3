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
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from rigs import Camera, Rig
from tomo._coarser import coarsening, coarser_grid, shrunk_image
from tomo.grid import VoxelGrid
from tomo.linear_system import LinearSystem, VolumeNotSeenError
from tomo.solve._common_start import common_start, log_smears
from tomo.solve.mlem import mlem
from tomo.viewed import ViewedOperator

CROSSINGS = 2_000_000
"""About the size of the coarser system that the shifts are found on."""

ROUNDS = 2
ITERATIONS = 2
STEP = 0.8
"""Share of the shifts found that is made each round: all views move at once."""

GROUPS = 4
"""Up to six views are left out one at a time, more in so many interleaved groups."""

REGISTRATION_STEPS = 6
WORTH_IT = 0.8
"""Share of the squared error of views left out that shifts must leave at most to be believed."""

FARTHEST = 0.05
"""Of an image's shorter side: a camera farther off is not merely a little off."""


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
    """

    shifts: NDArray[np.float64]
    error_before: float
    error_after: float
    accepted: bool
    reason: str

    def rig(self, rig: Rig) -> Rig:
        """Return the rig with its principal points shifted; as it is if not accepted."""
        if not self.accepted:
            return rig
        return _shifted(rig, self.shifts)

    def report(self) -> dict[str, Any]:
        """Return what a report says of the alignment: plain numbers and words."""
        return {
            "shifts": self.shifts.tolist(),
            "error_before": self.error_before,
            "error_after": self.error_after,
            "accepted": self.accepted,
            "reason": self.reason,
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
    factor = coarsening(rig, grid, CROSSINGS)
    small = [shrunk_image(image, mask, factor) for image, mask in zip(images, masks, strict=True)]
    coarse_rig = replace(rig, cameras=tuple(camera.shrunk(factor) for camera in rig))
    coarse_grid = coarser_grid(grid, factor)
    motions = [_motion(camera, grid) for camera in coarse_rig]

    shifts, best, errors = still, still, []
    for number in range(ROUNDS + 1):
        try:
            found, error, expected = _round(_shifted(coarse_rig, shifts), coarse_grid, small)
        except VolumeNotSeenError:
            return _refused(still, math.nan, math.nan, "the cameras do not see the volume")
        if not math.isfinite(error):
            return _refused(still, math.nan, math.nan, "the images are dark")
        if not errors or error < min(errors):
            best = shifts
        errors.append(error)
        if number == 0 and expected**2 > WORTH_IT * error**2:
            reason = "views left out lie where they are predicted"
            return _refused(still, error, expected, reason)
        shifts = _without_common_motion(shifts + STEP * found, motions)
    before, after = errors[0], min(errors)
    limits = [FARTHEST * min(camera.image_size) for camera in coarse_rig]
    if after**2 > WORTH_IT * before**2:
        return _refused(still, before, after, "shifts hardly improve the views left out")
    if (np.abs(best).max(axis=1) > limits).any():
        return _refused(still, before, after, "the shifts found are too large to be believed")
    reason = f"views left out are predicted to {after:.3f} instead of {before:.3f}"
    return Alignment(best * factor, before, after, True, reason)


def _refused(shifts: NDArray, before: float, after: float, reason: str) -> Alignment:
    return Alignment(shifts, before, after, False, reason)


def _round(
    rig: Rig, grid: VoxelGrid, small: Sequence[tuple[NDArray, NDArray]]
) -> tuple[NDArray[np.float64], float, float]:
    """Return every view's shift against the others, and the relative errors left out.

    The errors are of the predictions as they are, and as registration makes them.
    """
    images = [image for image, _ in small]
    masks = [mask for _, mask in small]
    system = LinearSystem.from_rig(rig, grid, masks=masks)
    measured = system.flatten(images)
    views = range(len(rig))
    count = len(rig) if len(rig) <= 6 else GROUPS
    shifts = np.zeros((len(rig), 2))
    smears = log_smears(system.projector, measured)
    raw = registered = light = 0.0
    for group in range(count):
        left_out = list(views[group::count])
        kept = [view for view in views if view not in left_out]
        volume = _volume(system.projector, measured, kept, smears)
        seen = system.images(system.projector @ volume)
        for view in left_out:
            shifts[view], before, after = _register(seen[view], images[view], masks[view])
            raw += before
            registered += after
            light += float(np.sum(np.square(images[view], dtype=np.float64)[masks[view]]))
    if light == 0:
        return shifts, math.nan, math.nan
    return shifts, math.sqrt(raw / light), math.sqrt(registered / light)


def _volume(
    projector: ViewedOperator, measured: NDArray, views: Sequence[int], smears: NDArray
) -> NDArray[np.float32]:
    """Return a few iterations of MLEM from some of the views."""
    found = mlem(
        projector.subset(views),
        measured[projector.pixels_of(views)],
        iterations=ITERATIONS,
        start=common_start(projector, measured, views, smears),
    )
    return projector.live.compress(found.volume)


def _register(
    predicted: NDArray, image: NDArray, mask: NDArray
) -> tuple[NDArray[np.float64], float, float]:
    """Return the shift that takes a prediction onto an image, and the squared errors around it.

    Gauss-Newton's method on shift and gain. Both errors are those with the gain that fits best:
    a brighter or darker camera is not one that looks elsewhere.
    """
    image = np.where(mask, image, 0).astype(np.float64)
    predicted = predicted.astype(np.float64)
    rows, columns = np.indices(image.shape)
    shift = np.zeros(2)

    def errors_at(shift: NDArray) -> tuple[float, NDArray, NDArray, float]:
        at = [rows - shift[1], columns - shift[0]]
        moved = map_coordinates(predicted, at, order=1, mode="constant") * mask
        energy = float(np.sum(moved**2))
        gain = float(np.sum(moved * image)) / energy if energy > 0 else 1.0
        residual = image - gain * moved
        return float(np.sum(residual**2)), moved, residual, gain

    before, moved, residual, gain = errors_at(shift)
    error = before
    for _ in range(REGISTRATION_STEPS):
        down, right = np.gradient(moved)
        columns_of = np.stack([moved, -gain * right, -gain * down])[:, mask]  # (3, pixels)
        normal = np.sum(columns_of[:, None] * columns_of[None], axis=2)
        normal += 1e-9 * np.trace(normal) * np.eye(3)
        if not normal.any():
            break
        step = np.linalg.solve(normal, np.sum(columns_of * residual[mask], axis=1))[1:]
        trial = shift + np.clip(step, -2, 2)
        found, *state = errors_at(trial)
        if found >= error:
            break
        error, shift = found, trial
        moved, residual, gain = state
    return shift, before, error


def _motion(camera: Camera, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return how far the image of the grid's middle moves as the world does: ``(2, 3)``."""
    step = 1e-3 * float(np.min(np.asarray(grid.shape) * grid.spacing))
    points = np.asarray(grid.center) + np.concatenate([np.eye(3), -np.eye(3)]) * step
    seen = np.asarray(camera.project(points)[0], np.float64)
    return np.nan_to_num((seen[:3] - seen[3:]).T / (2 * step))


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
