"""Changes of a rig as they are written on a command line."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rigs import Rig
    from rigs.changes import ImageChange

T = TypeVar("T")


@dataclass(frozen=True)
class RigChanges:
    """What the options ask for; see `of` for the order.

    Changes of the rig
    ------------------
    keep : CAMERA
        Keep this camera only; repeatable.
    drop : CAMERA
        Leave this camera out; repeatable.
    crop : X,Y,W,H
        The images were cropped: column and row of the top-left pixel, width and height.
        cam00=X,Y,W,H is for one camera; repeatable.
    rotate : DEGREES
        The images were turned clockwise by 90, 180 or 270 degrees. cam00=DEGREES is for one
        camera; repeatable.
    scale : S
        The images were shrunk S-fold, or enlarged where S is below 1, as by --scale of
        reconstruct. cam00=S is for one camera; repeatable.
    world : FILE
        Move the world: a YAML file with R and t of x_new = R x + t, or the points origin, x_axis
        and xy_plane, or points and what they become, or positions of cameras by name.
    rename : A=B
        Name camera A B; repeatable.
    """

    keep: Sequence[str] | None = None
    drop: Sequence[str] | None = None
    crop: Sequence[str] | None = None
    rotate: Sequence[str] | None = None
    scale: Sequence[str] | None = None
    world: Path | None = None
    rename: Sequence[str] | None = None

    def of(self, rig: Rig) -> tuple[Rig, list[str]]:
        """Return the changed rig and notes: cameras kept, images, world, then new names.

        Raises
        ------
        ValueError
            Naming the option or the camera.
        """
        from rigs.changes import ImageChange, with_cameras, with_images_changed

        kept = self._kept(rig)
        if kept != rig.names:
            rig = with_cameras(rig, {name: name for name in kept})
        windows = _by_camera(rig, self.crop, "--crop", _window)
        degrees = _by_camera(rig, self.rotate, "--rotate", _degrees)
        factors = _by_camera(rig, self.scale, "--scale", _factor)
        changes = {
            name: ImageChange(windows.get(name), degrees.get(name, 0), factors.get(name, 1.0))
            for name in windows | degrees | factors
        }
        notes = []
        if changes:
            before, rig = rig, with_images_changed(rig, changes)
            notes += _cut_sides(before, changes)
        if self.world is not None:
            rig, more = _in_world(rig, self.world)
            notes += more
        if self.rename:
            names = {name: name for name in rig.names}
            rig = with_cameras(rig, names | _new_names(rig, self.rename))
        return rig, notes

    def _kept(self, rig: Rig) -> tuple[str, ...]:
        """Return the names of the cameras to keep."""
        keep, drop = (_names(rig, texts) for texts in (self.keep, self.drop))
        names = tuple(n for n in rig.names if (not keep or n in keep) and n not in drop)
        if not names:
            raise ValueError("--keep and --drop: found no camera left, expected one or more")
        return names


def _names(rig: Rig, texts: Sequence[str] | None) -> set[str]:
    """Return the cameras named, several with commas between them in one text."""
    found = set()
    for text in texts or ():
        parts = [text] if text in rig else [part.strip() for part in text.split(",")]
        found |= {rig[name].name for name in parts}
    return found


def _by_camera(
    rig: Rig, texts: Sequence[str] | None, option: str, parse: Callable[[str, str], T]
) -> dict[str, T]:
    """Return values by camera: of ``CAMERA=VALUE``, or for all others of ``VALUE``."""
    own: dict[str, T] = {}
    common: dict[str, T] = {}
    for text in texts or ():
        name, is_own, value = text.rpartition("=")
        if is_own:
            known, into = (rig[name].name,), own
        else:
            known, into = rig.names, common
        if into.keys() & set(known):
            whose = f"camera {name}" if is_own else "all cameras"
            raise ValueError(f"{option}: found twice for {whose}, expected once")
        into |= dict.fromkeys(known, parse(value.strip(), option))
    return common | own


def _window(text: str, option: str) -> tuple[int, int, int, int]:
    if not re.fullmatch(r"\d{1,7}(,\d{1,7}){3}", text.replace(" ", ""), re.ASCII):
        raise ValueError(
            f"{option}: found {text!r}, expected pixels x,y,width,height like 0,8,64,48"
        )
    x, y, width, height = map(int, text.split(","))
    return x, y, width, height


def _degrees(text: str, option: str) -> int:
    if text not in ("0", "90", "180", "270"):
        raise ValueError(f"{option}: found {text!r}, expected 90, 180 or 270, clockwise")
    return int(text)


def _factor(text: str, option: str) -> float:
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not (math.isfinite(factor) and factor > 0):
        raise ValueError(
            f"{option}: found {text!r}, expected a number above 0 that the size of the images was "
            "divided by: 2 where it was halved, 0.5 where it was doubled"
        )
    return factor


def _new_names(rig: Rig, texts: Sequence[str]) -> dict[str, str]:
    """Return new names of cameras by their old ones, of ``A=B``."""
    names: dict[str, str] = {}
    for text in texts:
        signs = [match.start() for match in re.finditer("=", text)]
        if not signs:
            raise ValueError(f"--rename: found {text!r}, expected A=B, camera A's new name B")
        at = next((at for at in signs if text[:at] in rig), signs[0])
        old = rig[text[:at]].name
        if old in names:
            raise ValueError(f"--rename: found camera {old} twice, expected once")
        names[old] = text[at + 1 :]
    taken = set(rig.names) - set(names)
    for old, new in names.items():
        if new in taken:
            raise ValueError(
                f"--rename: found {old}={new}, but there is a camera {new}: choose another name, "
                "or rename that one as well"
            )
    return names


def _cut_sides(before: Rig, changes: dict[str, ImageChange]) -> list[str]:
    """Return a note where shrinking leaves a part of a pixel over."""
    cut = []
    for name, change in changes.items():
        size = replace(change, scale=1.0).of(before[name]).image_size
        if any(abs(n / change.scale - round(n / change.scale)) > 1e-6 for n in size):
            cut.append(f"{name} ({size[0]} x {size[1]})")
    if not cut:
        return []
    return [
        f"--scale: sides of {', '.join(cut)} are no multiples of it: what is left of the last "
        "column or row is taken to be cut off, not squeezed in"
    ]


def _in_world(rig: Rig, path: Path) -> tuple[Rig, list[str]]:
    """Return the rig in the world that a file describes, and what there is to say of it."""
    from rigs.files.world_file import load_world

    world = load_world(path, rig)
    moved, notes = world.of(rig), []
    if world.misfit:
        unit = rig.length_unit
        notes.append(f"{path}: the points' places are met within {world.misfit:.3g} {unit} RMS")
    if rig.volume is not None and moved.volume is None:
        notes.append(
            "volume: left out, as its faces are not along the new axes: give --grid, --spacing "
            "and --center to the commands that need one"
        )
    return moved, notes
