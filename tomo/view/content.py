"""What the viewer shows: a rig, its images, and the volumes in its middle, each where known."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.draw.frame import Up
from tomo.draw.rig.rig_scene import grid_of, up_of
from tomo.grid import VoxelGrid
from tomo.operators import LINEAR, Gains
from tomo.scan import Scan

MOST_BYTES = 256_000_000
"""Bytes of volumes kept. Lower: going back in a film reads again; higher: memory."""

SCALE_FRAMES = 5
"""Frames that the common scale of a film is taken from: reading all would take minutes."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a film, or the one of a still volume.

    ``names`` has one a frame, ``read`` returns the volume ``(nx, ny, nz)`` at a place in them, and
    ``most_bytes`` of volumes are kept besides the last one.
    """

    names: tuple[str, ...]
    read: Callable[[int], NDArray]
    most_bytes: int = MOST_BYTES
    _kept: OrderedDict = field(default_factory=OrderedDict, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.names)

    def volume(self, place: int) -> NDArray[np.float32]:
        """Return the volume of a frame, 0 where it has no finite value.

        Raises
        ------
        ValueError
            If the frame cannot be read.
        """
        kept = self._kept
        if place not in kept:
            read = np.ascontiguousarray(self.read(place), np.float32)
            volume = np.nan_to_num(read, nan=0.0, posinf=0.0, neginf=0.0)
            while kept and sum(one.nbytes for one in kept.values()) + volume.nbytes > (
                self.most_bytes
            ):
                kept.popitem(last=False)
            kept[place] = volume
        kept.move_to_end(place)
        return kept[place]

    def spread(self) -> Sequence[int]:
        """Return the places of a few frames spread over the film, the first one last."""
        count = min(len(self), SCALE_FRAMES)
        return sorted({round(at) for at in np.linspace(0, len(self) - 1, count)}, reverse=True)


@dataclass(frozen=True)
class Model:
    """How a reconstruction said that images come from its volume.

    Emission ``is_linear`` between the centres of voxels, or constant in each; ``gain`` and
    ``offset`` are those of a camera's images, 1 and 0 where none is known.
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
    rig : Rig, optional
        The cameras, as the volume was reconstructed by them.
    frames : Frames, optional
        The volumes on the grid.
    scan : Scan, optional
        What the cameras measured; its rig is ``rig``, at the size of its images.
    moments : tuple of str
        The name in the scan of each frame.
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
