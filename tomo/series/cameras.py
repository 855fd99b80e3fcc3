"""The cameras of a series: shifts that key frames agree on, poses refined by the middle one.

Not from the mean of the key frames: it has little fine structure, by which views are compared. On
a plume the shifts of its mean were a third larger than those that its frames agreed on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tomo.grid import VoxelGrid
from tomo.operators.system import Progress
from tomo.pipeline.options import Options
from tomo.pipeline.register import Registered, register_screened, shift_warnings
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record
from tomo.selfcal.shifts import Alignment, align_views
from tomo.series.images import FrameImages


def register_key_frames(
    screened: ScreenedScan,
    frames: Sequence[FrameImages],
    grid: VoxelGrid,
    options: Options,
    refine: Sequence[str],
    progress: Progress | None = None,
) -> Registered:
    """Return the cameras as key frames show them.

    Parameters
    ----------
    screened : ScreenedScan
        The cameras that take part.
    frames : sequence of FrameImages
        The key frames.
    grid : VoxelGrid
    options : Options
    refine : sequence of str
        The cameras to refine, if they take part.
    progress : callable, optional
    """
    rig = screened.scan.rig
    refine = tuple(name for name in refine if name in rig.names)
    alignment, warnings = None, []
    if options.align and not set(refine) >= set(rig.names):  # refinement finds shifts too
        found = [align_views(rig, one.images, grid, masks=one.masks) for one in frames]
        alignment = agreed(found)
        rig = alignment.rig(rig)
        warnings = shift_warnings(alignment, rig, screened.unmodelled_light)
    middle = frames[len(frames) // 2]
    one = replace(
        screened,
        scan=replace(screened.scan, rig=rig),
        images=middle.images,
        masks=middle.masks,
        screening=None,  # its noise is that of the mean
    )
    registered = register_screened(one, grid, replace(options, align=False), refine, progress)
    lines = (*warnings, *registered.record.warnings)
    record = Record(registered.record.seconds, lines)
    return replace(registered, alignment=alignment, record=record)


def agreed(found: Sequence[Alignment]) -> Alignment:
    """Return the median of the shifts of several frames, accepted where most of them are.

    Shifts that were not accepted do not count where most were.
    """
    taken = [one for one in found if one.accepted]
    if 2 * len(taken) <= len(found):
        taken = [one for one in found if not one.accepted]
    shifts, before, after = (
        np.median([getattr(one, name) for one in taken], axis=0)
        for name in ("shifts", "error_before", "error_after")
    )
    reason = f"median of {len(taken)} of {len(found)} key frames; in the last, {taken[-1].reason}"
    return Alignment(shifts, float(before), float(after), taken[0].accepted, reason)
