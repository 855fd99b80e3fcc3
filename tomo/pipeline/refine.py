"""Cameras whose poses are to be found from the images, where that is asked for.

Not from the mean of a film's frames: it has little fine structure, by which views are compared.
On a plume the shifts of its mean were a third larger than those that its frames agreed on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tomo.grid import VoxelGrid
from tomo.operators.system import Progress
from tomo.pipeline.frames import FrameImages
from tomo.pipeline.options import Options
from tomo.pipeline.screen import ScreenedScan
from tomo.selfcal.refine import Moment, Refinement, refine_over_moments
from tomo.selfcal.refine.search import FEWEST


def refine(
    screened: ScreenedScan,
    frames: Sequence[FrameImages],
    grid: VoxelGrid,
    options: Options,
    cameras: Sequence[str],
    progress: Progress | None = None,
) -> Refinement | None:
    """Refine cameras from every other frame, the first among them; the others judge.

    Parameters
    ----------
    screened : ScreenedScan
    frames : sequence of FrameImages
        Corrected; one judges itself.
    grid : VoxelGrid
    options : Options
    cameras : sequence of str
        Those to refine, if they take part; None is returned if none does.
    progress : callable, optional
    """
    rig = screened.scan.rig
    cameras = tuple(name for name in cameras if name in rig.names)
    if not (cameras and frames) or len(rig) < FEWEST:
        return None
    moments = [Moment(frame.images, frame.masks) for frame in frames]
    return refine_over_moments(
        rig,
        moments[::2],
        grid,
        judges=moments[1::2],
        cameras=cameras,
        prior_pixels=options.refine_prior,
        skip=options.skip,
        progress=progress,
    )


def sentence(found: Refinement, frames: int) -> str:
    """Return what was found of the cameras, from so many frames, and what to do."""
    names = ", ".join(found.cameras)
    if not found.accepted:
        return (
            f"cameras stay as the rig says: {names}: {found.reason}. Leave --refine-cameras out, "
            "or name other cameras"
        )
    farthest = int(np.nanargmax(found.moved_pixels))
    where = "the images" if frames == 1 else f"{frames} frames together"
    then = (
        "Use refined_rig.yaml for further frames"
        if frames == 1
        else "They are the store's corrected_rig; to keep the rig as it is, --refine-cameras none"
    )
    return (
        f"cameras refined from {where}: {names}: {found.reason}; "
        f"{found.given.names[farthest]} moves farthest, by {found.moved_pixels[farthest]:.1f} "
        f"pixels. {then}"
    )
