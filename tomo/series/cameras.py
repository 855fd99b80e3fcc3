"""Which cameras of a film its own frames put right."""

from __future__ import annotations

from tomo.pipeline.check_options import cameras_to_refine
from tomo.pipeline.options import Options
from tomo.scan import Scan
from tomo.selfcal.refine.search import FEWEST

FEWEST_FRAMES = 8
"""Frames of a film from which all cameras are refined without being asked for. Fewer: a few
seconds of planning are much for them. More: short films keep a wrong rig."""


def cameras_of_film(options: Options, scan: Scan, count: int) -> tuple[str, ...]:
    """Return the cameras to refine of a film of so many frames: those asked for, or all.

    None of too few views are refined, nor tables of rays.
    """
    asked = cameras_to_refine(options, scan)
    if options.refine_cameras is not None:
        return asked
    rig = scan.without(*options.hold_out).rig if options.hold_out else scan.rig
    able = tuple(camera.name for camera in rig if camera.has_pose)
    return able if count >= FEWEST_FRAMES and len(rig) >= FEWEST else ()
