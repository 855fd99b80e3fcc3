"""``flametomo convert-rig``: a rig in another format, and as images or the world were changed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tomo.cli.console import print_json, say
from tomo.cli.declared import converted
from tomo.cli.inputs import check_output_folder
from tomo.pipeline.declared import Check, choice, number

if TYPE_CHECKING:
    from rigs import Rig
    from rigs.changes import ImageChange

_TABLE = """
Formats, r: read, w: written:

\b
{formats}

Distortion or skew that a format cannot hold is refused, never dropped. Lens data, volume, world
frame and calibration figures are kept by our format only. The format of IN is recognised by its
content, that of OUT by its suffix.

OUT may be for images that were cropped, turned or binned, or in another world. Changes are made
in this order, whatever that of the options: unit of length, cameras kept, images cropped, then
turned, then scaled, the world, new names. Cameras are called by their names in IN.
"""


def _formats() -> str:
    from rigs.formats import FORMATS

    return "\n".join(
        f"  {item.name:<19}{'r' if item.reads else ' '}{'w' if item.writes else ' '}  {item.about}"
        + (f" ({', '.join('*' + suffix for suffix in item.suffixes)})" if item.suffixes else "")
        for item in FORMATS.values()
    )


EXAMPLES = """
flametomo convert-rig transforms.json rig.yaml --length-unit mm
flametomo convert-rig rig.yaml sparse --to colmap
flametomo convert-rig rig.yaml small.yaml --crop 0,8,640,464 --scale 2
"""
DETAILS = _TABLE.format(formats=_formats())


def convert_rig(
    source: Path,
    target: Path,
    /,
    *,
    from_: str | None = None,
    to: str | None = None,
    length_unit: str | None = None,
    image_size: Annotated[tuple[int, int] | None, _SIZE] = None,
    ray_tables: bool = False,
    json: bool = False,
    changes: RigChanges,
) -> None:
    """Convert a rig from one format into another.

    Parameters
    ----------
    source : IN
        The rig to read: a file, or a folder of files.
    target : OUT
        The rig to write: a file, or a folder.
    from_ : FORMAT
        Format of IN; recognised if absent.
    to : FORMAT
        Format of OUT; by its suffix if absent.
    length_unit : UNIT
        Unit of OUT, like mm. Lengths are converted where IN names its unit, and kept as they are
        where it names none.
    image_size : WxH
        Image size in pixels, like 640x480, for formats without it.
    ray_tables :
        Write every camera as a table of rays; those through a scene as they are where they pass
        the volume, so that the scene is no longer needed.
    """
    from rigs import formats
    from rigs.changes import as_ray_tables

    found = from_ or formats.sniff(source)
    rig = formats.load(source, found, length_unit=length_unit, image_size=image_size)
    rig, notes = changes.of(rig)
    if ray_tables:
        rig = as_ray_tables(rig)
    check_output_folder(target.parent)
    formats.save(rig, target, to)
    result = {
        "format": found,
        "cameras": list(rig.names),
        "length_unit": rig.length_unit,
        "file": str(target),
        "notes": notes,
    }
    for note in notes:
        say(f"note: {note}")
    if json:
        print_json(result)
    else:
        say(f"{target}: {len(rig)} cameras in {rig.length_unit}, from {found}")


def _pixels(count: int, mark: str, expected: str) -> Check:
    """Accept so many whole numbers with a mark between them."""

    def convert(text: str) -> tuple[int, ...]:
        parts = text.replace(" ", "").split(mark)
        if len(parts) != count or not all(re.fullmatch("[0-9]{1,7}", one) for one in parts):
            raise ValueError
        return tuple(map(int, parts))

    return Check(expected, convert)


_SIZE = _pixels(2, "x", "pixels like 640x480")
_WINDOW = _pixels(4, ",", "pixels x,y,width,height like 0,8,64,48")
_QUARTERS = choice("0", "90", "180", "270")
_DEGREES = Check("90, 180 or 270, clockwise", lambda text: int(_QUARTERS.convert(text)))
_FACTOR = Check(
    "a number above 0 that the size of the images was divided by: 2 where it was halved, 0.5 "
    "where it was doubled",
    number(above=0).convert,
)


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
        """Return the changed rig and notes: cameras kept, images, world, then new names."""
        from rigs.changes import ImageChange, with_cameras, with_images_changed

        kept = self._kept(rig)
        if kept != rig.names:
            rig = with_cameras(rig, {name: name for name in kept})
        windows = _by_camera(rig, self.crop, "--crop", _WINDOW)
        degrees = _by_camera(rig, self.rotate, "--rotate", _DEGREES)
        factors = _by_camera(rig, self.scale, "--scale", _FACTOR)
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


def _by_camera(rig: Rig, texts: Sequence[str] | None, option: str, check: Check) -> dict[str, Any]:
    """Return values by camera: of ``CAMERA=VALUE``, or for all others of ``VALUE``."""
    own: dict[str, Any] = {}
    common: dict[str, Any] = {}
    for text in texts or ():
        name, is_own, value = text.rpartition("=")
        if is_own:
            known, into = (rig[name].name,), own
        else:
            known, into = rig.names, common
        if into.keys() & set(known):
            whose = f"camera {name}" if is_own else "all cameras"
            raise ValueError(f"{option}: found twice for {whose}, expected once")
        into |= dict.fromkeys(known, converted(check, value.strip(), option))
    return common | own


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
