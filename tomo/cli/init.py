"""``flametomo init``: scan.yaml and rig.yaml of the images in a folder."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tomo.cli.console import print_json, say
from tomo.cli.images import value_of
from tomo.cli.inputs import Box, check_output_folder, parse_spacing, parse_triple
from tomo.pipeline.declared import whole

if TYPE_CHECKING:
    from tomo.scan.propose import Proposal, Request

EXAMPLES = """
flametomo init run7
flametomo init run7 --rig calibration/rig.yaml --dark run7/dark
flametomo init run7 --pattern '{camera}/burst2/{frame}.tif' --spacing 0.5
"""


def init(
    folder: Path,
    /,
    *,
    rig: str | None = None,
    pattern: str | None = None,
    dark: str | None = None,
    flat: str | None = None,
    bit_depth: Annotated[int | None, whole(1, 32)] = None,
    channel: str | None = None,
    bayer: str | None = None,
    length_unit: str | None = None,
    drop: Sequence[str] | None = None,
    rename: Sequence[str] | None = None,
    force: bool = False,
    json: bool = False,
    box: Box,
) -> None:
    """Write scan.yaml and rig.yaml for the images in a folder.

    Finds images by the names of cameras in their paths, dark and flat frames by theirs, and a rig
    or a table of cameras. Proposes the box of voxels from where the cameras look and their images
    are bright, and draws it into thumbnails.png. Whatever is assumed is said, and is a comment in
    the file.

    Parameters
    ----------
    folder : FOLDER
        The folder with images, and the rig.
    force :
        Overwrite what is there.

    What is in the folder, where init cannot tell
    ---------------------------------------------
    rig : RIG
        A rig of any format, a table of cameras, or a preset.
    pattern : PATTERN
        How images are named inside FOLDER, like '{camera}/{frame}.tif'.
    dark : FOLDER|FILE|LEVEL|none
        Dark frames in FOLDER, a level in full scales, or none.
    flat : FOLDER|FILE|LEVEL|none
        Flat frames in FOLDER, dark taken off, or none.
    bit_depth : N
        Bits of integers, where files do not say.
    channel : r|g|b|N
        The colour to reconstruct of images in colour, or the channel of images with several.
    bayer : ORDER
        Images are mosaics of colour filters in this order, like RGGB.
    length_unit : UNIT
        Unit of the rig's lengths, like mm.
    drop : CAMERA
        Leave this camera out; repeatable.
    rename : A=B
        Name camera A B; repeatable.
    """
    from tomo.draw.rig.thumbnails import contact_sheet, load_thumbnails
    from tomo.scan.propose import Request, write_proposal
    from tomo.scan.propose.contents import THUMBNAILS
    from tomo.scan.propose.write import check_writable

    request = Request(
        rig=rig,
        pattern=pattern,
        dark=_frames("dark", dark, folder),
        flat=_frames("flat", flat, folder),
        channel=None if channel is None else channel.lower(),
        bayer=None if bayer is None else bayer.upper(),
        bit_depth=bit_depth,
        rename=_renamed(rename or ()),
        drop=tuple(drop or ()),
        length_unit=length_unit,
        **_asked(box),
    )
    check_output_folder(folder)
    check_writable(folder, (THUMBNAILS,), force=force)
    found = _proposed(folder, request, may_ask=request == Request() and not json)
    moment = found.images.moments[1].name
    pictures = load_thumbnails(found.scan.rig, found.scan, moment, note=say)
    sheet = contact_sheet(
        found.scan.rig,
        pictures,
        found.grid,
        f"{folder.absolute().name}, frame {moment}, and the box of voxels",
    )
    written = write_proposal(found, {THUMBNAILS: sheet}, force=force)
    for about, lines in found.said.items():
        for number, line in enumerate(lines):
            say(f"{'  ' if number else about.replace('_', ' ') + ': '}{line}")
    commands = _next(folder, found)
    kept = "" if found.rig is None else ", rig.yaml"
    say(f"{written}{kept} and {THUMBNAILS}, to look at", "bold")
    for command in commands:
        say(f"next: {command}")
    if json:
        print_json(
            {
                "scan": str(written),
                "cameras": list(found.scan.rig.names),
                "frames": len(found.scan.frames),
                "images": found.images.pattern,
                "corrections": found.corrections,
                "grid": found.grid.to_mapping(),
                "length_unit": found.scan.rig.length_unit,
                "said": found.said,
                "next": commands,
            }
        )


def _proposed(folder: Path, request: Request, *, may_ask: bool) -> Proposal:
    """Return the proposal; in a terminal, a command without options asks what it cannot tell."""
    from tomo.scan.propose import UndecidedError, propose_scan

    while True:
        try:
            return propose_scan(folder, request)
        except UndecidedError as error:
            if not (may_ask and sys.stdin.isatty() and sys.stderr.isatty()):
                raise
            say(str(error).partition(": found")[0])
            for number, choice in enumerate(error.choices, 1):
                say(f"  {number}  {choice}")
            chosen = 0
            while not 0 < chosen <= len(error.choices):
                chosen = typer.prompt("which", type=int, err=True)
            request = replace(request, **{error.option: error.choices[chosen - 1]})


def _renamed(texts: Sequence[str]) -> dict[str, str]:
    """Return the new names of cameras of ``A=B``, by their old ones."""
    found = {}
    for text in texts:
        old, mark, new = text.partition("=")
        if not (old and mark and new):
            raise ValueError(f"--rename: found {text!r}, expected CAMERA=NAME")
        found[old] = new
    return found


def _frames(name: str, text: str | None, folder: Path) -> Any:
    """Return the value of scan.yaml for an option: a path inside the folder, a level, or none."""
    if text is None or text == "none" or "{camera}" in text:
        return text
    path = folder / text
    if not path.exists():
        value = value_of(name, text)
        if not isinstance(value, str):
            return value
        path = Path(text)
    if not path.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"--{name}: found {text}, expected a folder or file inside {folder}")
    return path.resolve().relative_to(folder.resolve()).as_posix()


def _asked(box: Box) -> dict[str, Any]:
    """Return what the options say of the grid: all of it, its box, or the edge of its voxels."""
    if box.grid is not None or box.center is not None:
        return {"grid": box.voxels()}
    if (box.lower is None) != (box.upper is None):
        raise ValueError("--lower and --upper: found one of them, expected both")
    found: dict[str, Any] = {}
    if box.lower is not None and box.upper is not None:
        found["box"] = parse_triple(box.lower, "--lower"), parse_triple(box.upper, "--upper")
    if box.spacing is not None:
        edges = parse_spacing(box.spacing)
        if len(set(edges)) > 1:
            raise ValueError(
                f"--spacing: found {box.spacing}, expected one length, or --grid with it"
            )
        found["voxel"] = edges[0]
    return found


def _next(folder: Path, found: Proposal) -> list[str]:
    """Return the commands that come next."""
    name = shlex.quote(str(folder))
    out = re.sub(r"[^\w.-]+", "_", folder.absolute().name) or "flame"
    options = f" --scale {found.scale}" if found.scale > 1 else ""
    if any(camera.status == "nominal" for camera in found.scan.rig):
        options += " --refine-cameras nominal"
    return [
        f"flametomo check-rig {name}",
        f"flametomo reconstruct {name}{options} -o {shlex.quote(f'out/{out}')}",
    ]
