"""What the viewer shows: a rig, its images, and the volumes in its middle, each where known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rigs import Rig
from tomo.draw.frame import Up
from tomo.draw.rig.rig_scene import grid_of, up_of
from tomo.grid import VoxelGrid
from tomo.operators import LINEAR, Gains
from tomo.scan import Scan
from tomo.view.frames import Frames


@dataclass(frozen=True)
class Model:
    """How a reconstruction said that images come from its volume.

    Attributes
    ----------
    is_linear : bool
        Whether emission is linear between the centres of voxels, rather than constant in each.
    gain, offset : mapping
        Camera to the gain and the background of its images; 1 and 0 where none is known.
    """

    is_linear: bool = False
    gain: Mapping[str, float] = field(default_factory=dict)
    offset: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, basis: Mapping[str, Any] | None, gains: Mapping[str, Any] | None) -> Model:
        """Return the model of a report's ``basis`` and ``gains``."""
        known = gains or {}
        is_linear = (basis or {}).get("name") == LINEAR
        return cls(is_linear, known.get("gain") or {}, known.get("offset") or {})

    def gains_of(self, camera: str) -> Gains | None:
        """Return the gain and the background of one camera; None where none are known."""
        if camera not in self.gain:
            return None
        known = Gains.none(1)
        gain, offset = self.gain[camera], self.offset.get(camera, 0.0)
        return replace(known, gain=np.array([float(gain)]), offset=np.array([float(offset)]))


@dataclass(frozen=True, eq=False)
class Content:
    """What to show.

    Attributes
    ----------
    title : str
    rig : Rig, optional
        The cameras, as the volume was reconstructed by them.
    grid : VoxelGrid, optional
    frames : Frames, optional
        The volumes on the grid.
    scan : Scan, optional
        What the cameras measured; its rig is ``rig``, at the size of its images.
    moments : tuple of str
        The name in the scan of each frame.
    value_unit : str
        Of the volumes; empty if unknown.
    length_unit : str
    model : Model
        How images come from the volume.
    residual : callable, optional
        From a camera's name and a frame's place to the relative residual on record, or None.
    notes : tuple of str
        What is missing, and what to do to see it.
    """

    title: str
    rig: Rig | None = None
    grid: VoxelGrid | None = None
    frames: Frames | None = None
    scan: Scan | None = None
    moments: tuple[str, ...] = ()
    value_unit: str = ""
    length_unit: str = "mm"
    model: Model = field(default_factory=Model)
    residual: Callable[[str, int], float | None] | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check that there is something to show, and that volumes have their grid."""
        if self.rig is None and self.frames is None:
            raise ValueError(f"{self.title}: found neither a rig nor a volume, expected one")
        if self.frames is not None and self.grid is None:
            raise ValueError(f"{self.title}: found a volume without a grid, expected its grid")
        if self.scan is not None and len(self.moments) != self.n_frames:
            raise ValueError(
                f"{self.title}: found {len(self.moments)} names of frames for {self.n_frames} "
                "frames, expected one each"
            )

    @property
    def n_frames(self) -> int:
        """How many moments can be chosen: volumes, or those of the images alone."""
        return len(self.moments) if self.frames is None else len(self.frames)

    @property
    def names(self) -> tuple[str, ...]:
        """How each moment is called."""
        return self.moments if self.frames is None else self.frames.names

    @property
    def box(self) -> VoxelGrid | None:
        """The grid, or the box that travels with the rig."""
        return self.grid if self.rig is None else grid_of(self.rig, self.grid)

    @property
    def up(self) -> Up:
        """The world's axis that the images show upward."""
        return Up() if self.rig is None else up_of(self.rig)
