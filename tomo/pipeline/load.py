"""Stage 1, load: the images of one frame, corrected, and their usable pixels."""

from __future__ import annotations

from dataclasses import dataclass

from tomo.pipeline.stage import Record, timed
from tomo.scan import Scan
from tomo.scan.scan import Images, Masks


@dataclass(frozen=True, eq=False)
class LoadedScan:
    """One frame of a scan in memory.

    Attributes
    ----------
    scan : Scan
    frame : str
        The frame's whole name.
    images : list of (height, width) float32
        One a camera, in the rig's order.
    masks : list of (height, width) bool
        True where a pixel is usable.
    record : Record
    """

    scan: Scan
    frame: str
    images: Images
    masks: Masks
    record: Record = Record()


def load(scan: Scan, frame: str | None) -> LoadedScan:
    """Read a frame's images; the first frame's when None."""
    with timed() as stage:
        name = scan.frame(frame).name
        images, masks = scan.read(name)
    return LoadedScan(scan, name, images, masks, stage.record)
