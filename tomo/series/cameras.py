"""The cameras of a series: refined from many frames together.

Not from the mean of the key frames: it has little fine structure, by which views are compared. On
a plume the shifts of its mean were a third larger than those that its frames agreed on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import estimate_noise
from tomo.operators.system import Progress
from tomo.pipeline.options import Options
from tomo.pipeline.register import Registered, register
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.selfcal.refine import Moment, Refinement, refine_over_moments
from tomo.selfcal.refine.search import FEWEST
from tomo.series.images import FrameImages

FEWEST_FRAMES = 8
"""Frames of a film from which all cameras are refined without being asked for. Fewer: a few
seconds of planning are much for them. More: short films keep a wrong rig."""


def register_key_frames(
    screened: ScreenedScan,
    frames: Sequence[FrameImages],
    others: Sequence[FrameImages],
    grid: VoxelGrid,
    options: Options,
    asked: Sequence[str],
    progress: Progress | None = None,
) -> Registered:
    """Return the cameras as frames of the film show them.

    Parameters
    ----------
    screened : ScreenedScan
        The cameras that take part.
    frames : sequence of FrameImages
        The key frames.
    others : sequence of FrameImages
        The frames that refine cameras and those that judge, in turn; none: nothing is refined.
    grid : VoxelGrid
    options : Options
    asked : sequence of str
        The cameras that are to be refined, if they take part; all where options ask for none.
    progress : callable, optional
    """
    rig = screened.scan.rig
    refine = _able(rig) if options.refine_cameras is None else asked
    refine = tuple(name for name in refine if name in rig.names)
    refinement = None
    with timed() as stage:
        if refine and others:
            refinement = refine_from_frames(rig, others, grid, options, refine, progress)
            rig = refinement.rig
            if refinement.accepted or asked:
                stage.warnings.append(_of_refinement(refinement, -(-len(others) // 2)))
    middle = frames[len(frames) // 2]
    one = replace(
        screened,
        scan=replace(screened.scan, rig=rig),
        images=middle.images,
        masks=middle.masks,
        noise=tuple(
            estimate_noise(*both) for both in zip(middle.images, middle.masks, strict=True)
        ),
    )
    registered = register(one, grid, options)
    record = Record(
        stage.record.seconds + registered.record.seconds,
        (*stage.record.warnings, *registered.record.warnings),
    )
    return replace(registered, refinement=refinement, record=record)


def refine_from_frames(
    rig: Rig,
    frames: Sequence[FrameImages],
    grid: VoxelGrid,
    options: Options,
    cameras: Sequence[str],
    progress: Progress | None = None,
) -> Refinement:
    """Refine cameras from every other frame, the first among them; the others judge."""
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


def refines(options: Options, asked: Sequence[str], count: int) -> bool:
    """Return whether cameras of a film of so many frames are refined, asked for or not."""
    return bool(asked) or (options.refine_cameras is None and count >= FEWEST_FRAMES)


def _able(rig: Rig) -> tuple[str, ...]:
    """Return the cameras that can be refined: none of too few, no tables of rays."""
    able = tuple(camera.name for camera in rig if camera.has_pose)
    return able if len(rig) >= FEWEST else ()


def _of_refinement(found: Refinement, frames: int) -> str:
    names = ", ".join(found.cameras)
    if found.accepted:
        farthest = int(np.nanargmax(found.moved_pixels))
        return (
            f"cameras refined from {frames} frames together: {names}: "
            f"{found.reason} in other frames; {found.given.names[farthest]} moves farthest, "
            f"by {found.moved_pixels[farthest]:.1f} pixels. They are the store's corrected_rig; "
            "to keep the rig as it is, --refine-cameras none"
        )
    return f"cameras stay as the rig says: {names}: {found.reason}"
