"""Convert camera rigs between formats: ours, OpenCV, COLMAP, transforms.json and others."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

import re
from pathlib import Path
from typing import Annotated

import typer
from _command import bad_input_in_one_line, check_output_folder, print_json
from _usage import OneLineUsage

app = typer.Typer(add_completion=False, rich_markup_mode=None)

_TABLE = """
The formats, r read and w written:

\b
{formats}

A lens or a skew that a format cannot hold is refused, never dropped; what no format but ours holds
(lens data, volume, world, calibration's figures) stays behind. Formats tell by content what they
are, or by the ending of the file to write.
"""


def _formats() -> str:
    from rigs.formats import FORMATS

    return "\n".join(
        f"  {item.name:<13}{'r' if item.reads else ' '}{'w' if item.writes else ' '}  {item.about}"
        + (f" ({', '.join('*' + suffix for suffix in item.suffixes)})" if item.suffixes else "")
        for item in FORMATS.values()
    )


@app.command(cls=OneLineUsage, help=__doc__ + "\n" + _TABLE.format(formats=_formats()))
def convert_rig(
    source: Annotated[
        Path, typer.Argument(metavar="IN", help="The rig to read: a file, or a folder of files.")
    ],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="The rig to write: a file, or a folder.")
    ],
    from_format: Annotated[
        str | None, typer.Option("--from", help="What IN is, where its content does not tell.")
    ] = None,
    to_format: Annotated[
        str | None, typer.Option("--to", help="What OUT is to be, where its ending does not tell.")
    ] = None,
    length_unit: Annotated[
        str | None,
        typer.Option(
            help="Unit of the lengths written, like mm: converted where IN says what its own "
            "are, else taken to be it."
        ),
    ] = None,
    image_size: Annotated[
        str | None,
        typer.Option(help="Width and height in pixels, like 640x480, for formats without them."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Convert a rig from one format into another."""
    from rigs import formats

    with bad_input_in_one_line():
        found = from_format or formats.sniff(source)
        rig = formats.load(
            source, found, length_unit=length_unit, image_size=_parse_size(image_size)
        )
        check_output_folder(target.parent)
        formats.save(rig, target, to_format)
    result = {
        "format": found,
        "cameras": list(rig.names),
        "length_unit": rig.length_unit,
        "file": str(target),
    }
    if as_json:
        print_json(result)
    else:
        typer.echo(f"{target}: {len(rig)} cameras in {rig.length_unit}, from {found}", err=True)


def _parse_size(text: str | None) -> tuple[int, int] | None:
    """Return width and height of ``640x480``."""
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,7})x(\d{1,7})", text.strip(), re.ASCII)
    if match is None:
        raise ValueError(f"--image-size: found {text!r}, expected pixels like 640x480")
    return int(match[1]), int(match[2])
