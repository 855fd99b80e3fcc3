"""What a user says of a folder of images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tomo.grid import VoxelGrid

NONE = "none"
"""As dark or flat: such frames are left out."""


@dataclass(frozen=True)
class Request:
    """What a user says of a folder; the rest is found in it.

    Attributes
    ----------
    rig : str, optional
        A rig, in the folder or elsewhere: what `rigs.load` takes.
    pattern : str, optional
        How images are named, relative to the folder.
    dark, flat : str or float, optional
        The value of scan.yaml, or ``none``.
    channel, bayer : str, optional
    bit_depth : int, optional
    rename : mapping
        New names of cameras, by those of the rig.
    drop : tuple of str
        Cameras to leave out.
    length_unit : str, optional
        The rig's, as `rigs.load` takes it.
    grid : VoxelGrid, optional
    box : (lower, upper), optional
        Its corners, where only the voxels are to be proposed.
    voxel : float, optional
        Its edge, where only the box is to be proposed.
    """

    rig: str | None = None
    pattern: str | None = None
    dark: str | float | None = None
    flat: str | float | None = None
    channel: str | None = None
    bayer: str | None = None
    bit_depth: int | None = None
    rename: Mapping[str, str] = field(default_factory=dict)
    drop: tuple[str, ...] = ()
    length_unit: str | None = None
    grid: VoxelGrid | None = None
    box: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    voxel: float | None = None
