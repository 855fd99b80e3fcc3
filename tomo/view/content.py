"""What the viewer shows: a rig, its images, and the volumes in its middle, each where known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from rigs.scene.scene_camera import own_camera
from tomo.draw.frame import Up
from tomo.draw.rig.rig_scene import Target, grid_of, up_of
from tomo.grid import VoxelGrid
from tomo.scan import Scan
from tomo.view.comparison import Model
from tomo.view.frames import Frames


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

    @property
    def target(self) -> Target:
        """What the cameras look at, and how large it is."""
        if self.rig is not None:
            return Target.of(self.rig, self.box)
        assert self.grid is not None  # without a rig there are volumes, which have one
        return Target(np.array(self.grid.center), float(np.linalg.norm(self.grid.extent) / 2))

    @property
    def reach(self) -> float:
        """How far from the target's middle the scene goes."""
        if self.rig is None:
            return self.target.radius
        away = [own_camera(camera).position - self.target.center for camera in self.rig]
        return max(self.target.radius, *(float(np.linalg.norm(one)) for one in away))

    def images(self, place: int) -> dict[str, NDArray[np.float32]]:
        """Return the measured images of a moment, by camera; none where no scan is known."""
        if self.scan is None:
            return {}
        images = self.scan.images(self.moments[place])
        return dict(zip(self.scan.rig.names, images, strict=True))
