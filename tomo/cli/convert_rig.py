"""``flametomo convert-rig``: ours, OpenCV, COLMAP, transforms.json and other formats."""

from __future__ import annotations

import re
from pathlib import Path

from tomo.cli.console import print_json, say
from tomo.cli.inputs import check_output_folder
from tomo.cli.rig_changes import RigChanges

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
    image_size: str | None = None,
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
    rig = formats.load(source, found, length_unit=length_unit, image_size=_parse_size(image_size))
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


def _parse_size(text: str | None) -> tuple[int, int] | None:
    """Return width and height of ``640x480``."""
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,7})x(\d{1,7})", text.strip(), re.ASCII)
    if match is None:
        raise ValueError(f"--image-size: found {text!r}, expected pixels like 640x480")
    return int(match[1]), int(match[2])
