"""What a user says of a folder of images. Some folders can be read in several ways."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tomo.grid import VoxelGrid


class UndecidedError(ValueError):
    """Several things in a folder could be what a scan needs: one has to be named.

    Parameters
    ----------
    where : object
        The folder; the message begins with it.
    what : str
        What was looked for.
    choices : sequence of str
        Values of the option, two or more.
    option : str
        The parameter of `propose_scan` that decides.

    Examples
    --------
    >>> print(UndecidedError("run", "rigs", ["a.json", "b.json"], "rig"))
    run: rigs: found a.json and b.json, expected one: rig='a.json', say
    """

    def __init__(self, where: object, what: str, choices: Sequence[str], option: str) -> None:
        self.choices, self.option = tuple(choices), option
        named = f"{', '.join(choices[:-1])} and {choices[-1]}"
        super().__init__(
            f"{where}: {what}: found {named}, expected one: {option}='{choices[0]}', say"
        )


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
