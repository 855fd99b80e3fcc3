"""Refine cameras until they agree about the volume, and keep that only if it predicts better.

The images are predicted from a quick volume of all the cameras, and what is left of them is
regressed on how each prediction changes with its camera's position, turn, focal length and gain,
the volume free to change along (`tomo.selfcal.refine.joint_step`), and held back by the prior
(`tomo.selfcal.refine.prior`). That is repeated while it helps. A fifth of all rays, in tiles,
takes no part: predicted from other views, before and after, they say which rig is the better one
and whether it is good enough to be believed.

Wieneke, "Volume self-calibration for 3D particle image velocimetry", Experiments in Fluids 45
(2008), refines cameras from disparities of particles; Golub and Pereyra, "The differentiation of
pseudo-inverses and nonlinear least squares problems whose variables separate", SIAM Journal on
Numerical Analysis 10 (1973), for why the volume has to take part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.operators.system import VolumeNotSeenError
from tomo.scan.downsample import coarsening
from tomo.selfcal.refine.common_motion import without_common_motion
from tomo.selfcal.refine.parameters import COUNT
from tomo.selfcal.refine.prior import prior_lengths
from tomo.selfcal.refine.problem import Task
from tomo.selfcal.refine.refinement import Refinement

Progress = Callable[[int, int, str], None]

CROSSINGS = 6_000_000
"""About the size of the finest system, before empty voxels are left out."""

ROUNDS = 6
"""Steps at most."""

SETTLED = 0.02
PATIENCE = 2
"""Smaller steps end the rounds, in pixels, RMS over the cameras, and so do so many rounds without
a better prediction of held-out rays."""

FEWEST = 3
"""Views: two agree about nearly everything whatever their cameras."""


def refine_cameras(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    grid: VoxelGrid,
    *,
    cameras: Sequence[str] | None = None,
    masks: Sequence[NDArray[np.bool_]] | None = None,
    prior_pixels: float | None = None,
    skip: bool = True,
    progress: Progress | None = None,
) -> Refinement:
    """Refine position, turn, focal length and gain of some cameras.

    Parameters
    ----------
    rig : Rig
    images : sequence of (height, width)
        One a camera: only those that the reconstruction may use.
    grid : VoxelGrid
    cameras : sequence of str, optional
        The names of those to refine; all when None. The others stay as they are.
    masks : sequence of (height, width) bool, optional
        True where a pixel is usable.
    prior_pixels : float, optional
        The prior's standard deviation in pixels for every camera; when None that of
        `prior_lengths`: from the rig's calibration.
    skip : bool
        Whether to leave out voxels that dark pixels prove empty.
    progress : callable, optional
        ``progress(done, total, where)``.

    Raises
    ------
    ValueError
        If a name is unknown or that of a table of rays, there are fewer than three views, images
        do not fit the cameras, or the prior is not positive.
    """
    chosen = _chosen(rig, cameras)
    _check(rig, images, masks, prior_pixels)
    masks = [np.isfinite(image) for image in images] if masks is None else list(masks)
    pixels = prior_lengths(rig, grid) if prior_pixels is None else np.full(len(rig), prior_pixels)
    brightest = max(
        float(np.max(i, initial=0, where=m)) for i, m in zip(images, masks, strict=True)
    )
    task = Task(rig, tuple(images), tuple(masks), grid, chosen, pixels, skip)
    if brightest <= 0:
        return task.refused("the images are dark")
    factor = coarsening(rig, grid, CROSSINGS)
    parameters = best = np.zeros((len(rig), COUNT))
    courses, best_round = [], -1
    try:
        level = task.level(factor)
        before = after = level.judged(parameters)
        for number in range(ROUNDS):
            if progress:
                progress(number, ROUNDS, "refining cameras")
            step = level.step(parameters)
            parameters = parameters + step
            if len(chosen) == len(rig):
                parameters = without_common_motion(rig, grid, parameters, task.lengths)
            found = level.judged(parameters)
            courses.append(found.relative_error)
            if found.squared_errors.sum() < after.squared_errors.sum():
                best, after, best_round = parameters, found, number
            if task.size(step) < SETTLED * factor or number - best_round >= PATIENCE:
                break
    except VolumeNotSeenError:
        return task.refused("the cameras do not see the volume")
    if progress:
        progress(ROUNDS, ROUNDS, "")
    return task.judged(best, before, after, courses)


def _chosen(rig: Rig, cameras: Sequence[str] | None) -> tuple[int, ...]:
    """Return the places of the cameras to refine, in the rig's order."""
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
        if not rig[name].has_lens_model:
            raise ValueError(
                f"refine_cameras: camera {name}: found a table of rays, expected a lens model"
            )
    if not cameras:
        raise ValueError("refine_cameras: found no camera, expected at least one")
    return tuple(view for view, name in enumerate(rig.names) if name in cameras)


def _check(
    rig: Rig,
    images: Sequence[NDArray],
    masks: Sequence[NDArray] | None,
    prior_pixels: float | None,
) -> None:
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
    if prior_pixels is not None and not (math.isfinite(prior_pixels) and prior_pixels > 0):
        raise ValueError(f"prior_pixels: found {prior_pixels}, expected pixels above 0")
