"""Refinement of cameras in outer iterations, accepted only if held-out rays are predicted better.

Each outer iteration predicts the images from a quick volume of all cameras, one a moment. The
residuals are fitted by changes of each camera's position, rotation, focal length and gain,
together with changes of the volumes (`tomo.selfcal.refine.joint_step`) and under a prior
(`tomo.selfcal.refine.prior`). Iterations continue while they help. A fifth of all rays, in tiles,
is held out. Predicted from other views before and after, the held-out rays decide which rig is
better and whether it is accepted.

Wieneke, "Volume self-calibration for 3D particle image velocimetry", Experiments in Fluids 45
(2008), refines cameras from disparities of particles; Golub and Pereyra, "The differentiation of
pseudo-inverses and nonlinear least squares problems whose variables separate", SIAM Journal on
Numerical Analysis 10 (1973), explain why the volume must be free in the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from rigs.progress import Progress
from tomo.grid import VoxelGrid
from tomo.operators.system import VolumeNotSeenError
from tomo.scan.downsample import coarsening
from tomo.selfcal.refine.common_motion import without_common_motion
from tomo.selfcal.refine.moment import Moment
from tomo.selfcal.refine.parameters import COUNT
from tomo.selfcal.refine.prior import prior_lengths
from tomo.selfcal.refine.problem import Task
from tomo.selfcal.refine.refinement import Refinement

SEGMENTS = 6_000_000
"""Approximate segments of the system, before empty voxels are carved away. More take time and
memory; fewer leave pixels too coarse for small errors."""

ROUNDS = 6
"""Outer iterations at most. Fewer stop before large errors are gone; more take longer."""

SETTLED = 0.02
"""Step below which the iterations end, in pixels, RMS over the cameras. Larger, errors remain;
smaller, iterations are wasted."""

PATIENCE = 2
"""Outer iterations without a better prediction of held-out rays, after which they end. Fewer stop
at a setback by chance; more take longer."""

BETTER = 0.005
"""Fraction of the squared error of held-out rays by which an iteration has to improve to count as
better. Larger, slow progress is given up; smaller, iterations are spent on chance."""

FEWEST = 3
"""Views that a refinement needs at least: two views agree with nearly any cameras."""


def refine_cameras(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    grid: VoxelGrid,
    *,
    masks: Sequence[NDArray[np.bool_]] | None = None,
    **how: Any,
) -> Refinement:
    """Refine position, rotation, focal length and gain of some cameras from one moment.

    Parameters
    ----------
    rig : Rig
    images : sequence of (height, width)
        One image a camera, of the cameras that the reconstruction uses; held-out views excluded.
    grid : VoxelGrid
    masks : sequence of (height, width) bool, optional
        True where a pixel is usable.
    how
        Further arguments of `refine_over_moments`, which says what is raised.
    """
    _check(rig, images, masks)
    return refine_over_moments(rig, [Moment.of(images, masks)], grid, **how)


def refine_over_moments(
    rig: Rig,
    moments: Sequence[Moment],
    grid: VoxelGrid,
    *,
    judges: Sequence[Moment] = (),
    cameras: Sequence[str] | None = None,
    prior_pixels: float | None = None,
    skip: bool = True,
    progress: Progress | None = None,
) -> Refinement:
    """Refine some cameras from several moments together, each with a volume of its own.

    Parameters
    ----------
    rig : Rig
    moments : sequence of Moment
        The images that the cameras are refined from; a dark moment says nothing.
    grid : VoxelGrid
    judges : sequence of Moment
        Other moments, whose held-out rays decide; those of ``moments`` where there are none.
    cameras : sequence of str, optional
        Names of the cameras to refine; all when None. The others stay as given.
    prior_pixels : float, optional
        Standard deviation of the prior in pixels for every camera. When None it follows from
        the rig's calibration, see `prior_lengths`.
    skip : bool
        Whether to carve away voxels that dark pixels show to be empty.
    progress : callable, optional
        ``progress(done, total, where)``.

    Raises
    ------
    ValueError
        If a name is unknown or belongs to a table of rays, if there are fewer than three views,
        if images do not fit the cameras, or if the prior is not positive.
    """
    chosen = _chosen(rig, cameras)
    for moment in (*moments, *judges):
        _check(rig, moment.images, moment.masks)
    _check_prior(prior_pixels)
    pixels = prior_lengths(rig, grid) if prior_pixels is None else np.full(len(rig), prior_pixels)
    lit, judging = (
        tuple(one for one in some if one.brightest > 0) for some in (moments, judges or moments)
    )
    task = Task(rig, lit, judging, grid, chosen, pixels, skip)
    if not (lit and judging):
        return task.unchanged("the images are dark")
    factor = coarsening(rig, grid, SEGMENTS)
    parameters = best = np.zeros((len(rig), COUNT))
    errors_by_round, best_round = [], -1
    try:
        level = task.level(factor)
        before = after = level.held_out_errors(parameters)
        for number in range(ROUNDS):
            if progress:
                progress(number, ROUNDS, "refining cameras")
            step = level.step(parameters)
            parameters = parameters + step
            if len(chosen) == len(rig):
                parameters = without_common_motion(rig, grid, parameters, task.lengths)
            found = level.held_out_errors(parameters)
            errors_by_round.append(found.relative_error)
            error, least = found.squared_errors.sum(), after.squared_errors.sum()
            if error < (1 - BETTER) * least:
                best_round = number
            if error < least:
                best, after = parameters, found
            if task.size(step) < SETTLED * factor or number - best_round >= PATIENCE:
                break
    except VolumeNotSeenError:
        return task.unchanged("the cameras do not see the volume")
    if progress:
        progress(ROUNDS, ROUNDS, "")
    return task.result(best, before, after, errors_by_round)


def _chosen(rig: Rig, cameras: Sequence[str] | None) -> tuple[int, ...]:
    """Return the indices of the cameras to refine, in the rig's order."""
    if len(rig) < FEWEST:
        raise ValueError(
            f"refine_cameras: found {len(rig)} views to refine with, expected at least {FEWEST}"
        )
    cameras = rig.names if cameras is None else cameras
    for name in cameras:
        if name not in rig.names:
            raise ValueError(
                f"refine_cameras: found camera {name!r}, expected one of {', '.join(rig.names)}"
            )
        if not rig[name].has_pose:
            raise ValueError(
                f"refine_cameras: camera {name}: found a table of rays, or a view by a mirror, "
                "expected a camera with a lens and a pose"
            )
    if not cameras:
        raise ValueError("refine_cameras: found no camera, expected at least one")
    return tuple(view for view, name in enumerate(rig.names) if name in cameras)


def _check(rig: Rig, images: Sequence[NDArray], masks: Sequence[NDArray] | None) -> None:
    for what, found in (("images", images), ("masks", masks)):
        if found is None:
            continue
        if len(found) != len(rig):
            raise ValueError(f"{what}: found {len(found)}, expected one for each of {len(rig)}")
        for camera, own in zip(rig, found, strict=True):
            if np.shape(own) != camera.image_size[::-1]:
                raise ValueError(
                    f"{what}: camera {camera.name}: found shape {np.shape(own)}, "
                    f"expected {camera.image_size[::-1]}"
                )


def _check_prior(pixels: float | None) -> None:
    if pixels is not None and not (math.isfinite(pixels) and pixels > 0):
        raise ValueError(f"prior_pixels: found {pixels}, expected pixels above 0")
