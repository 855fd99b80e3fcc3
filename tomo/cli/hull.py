"""``flametomo hull``: the visual hull of an opaque thing from its silhouettes."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated

import typer

from tomo.cli.console import JsonFlag, print_json, say
from tomo.cli.corrections import ChannelOption, DarkOption, MaskOption, corrected
from tomo.cli.errors import bad_input_in_one_line
from tomo.cli.inputs import (
    CenterOption,
    GridOption,
    ImagesOption,
    LowerOption,
    PatternOption,
    RigInsteadOption,
    ScanArgument,
    SpacingOption,
    UpperOption,
    named_scan,
    parse_grid,
)

EXAMPLES = """
flametomo hull scan -o out/hull
flametomo hull --rig dinoSR_par.txt --images . --channel r --threshold 0.15
    --grid 324x382x326 --spacing 0.00025 --center -0.0255,0.0247,-0.0212
    --close 10 --grow 3 -o hull
flametomo hull --rig rig.yaml --images silhouettes --threshold 0.5
    --close 0 --grow 0 --grid 200x200x200 --spacing 0.1 -o hull
"""


def hull(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="The folder to write.")
    ],
    scan: ScanArgument = None,
    rig: RigInsteadOption = None,
    images: ImagesOption = None,
    *,
    grid: GridOption = None,
    spacing: SpacingOption = None,
    center: CenterOption = None,
    lower: LowerOption = None,
    upper: UpperOption = None,
    pattern: PatternOption = None,
    frame: Annotated[
        str | None, typer.Option(metavar="FRAME", help="The moment; the first by default.")
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            metavar="LEVEL",
            help="Pixels above it see the thing, in full scales of integers; by default what "
            "parts bright from dark pixels best (Otsu).",
        ),
    ] = None,
    close: Annotated[
        int,
        typer.Option(
            metavar="PIXELS",
            help="Gaps up to twice as wide are closed, and holes filled; 0: neither.",
            min=0,
            max=1000,
        ),
    ] = 5,
    grow: Annotated[
        int,
        typer.Option(
            metavar="PIXELS",
            help="By how much silhouettes grow, for cameras that point wrongly by as much.",
            min=0,
            max=1000,
        ),
    ] = 1,
    votes: Annotated[
        int, typer.Option(help="Views that must exclude a voxel.", min=1, max=255)
    ] = 1,
    dark: DarkOption = None,
    mask: MaskOption = None,
    channel: ChannelOption = None,
    json: JsonFlag = False,
) -> None:
    """Find the voxels of an opaque thing that no silhouette excludes.

    Writes the hull, 1 inside and 0 outside, as hull.npz, hull.vti and hull.nrrd. hull.json has
    the intersection over union of each silhouette and the hull's image.
    """
    with bad_input_in_one_line():
        from rigs.files import whole_folder
        from tomo.cli.outputs import check_output_volume
        from tomo.hull.opaque import otsu, silhouette, visual_hull
        from tomo.io import write_volume

        found = named_scan(scan, rig, images, pattern)
        found = corrected(found, {"dark": dark, "mask": mask, "channel": channel})
        check_output_volume(out, found.rig, found.source)
        voxels = parse_grid(grid, spacing, center, lower, upper, default=found.grid)
        pictures, masks = found.read(frame)
        level = otsu(pictures) if threshold is None else threshold
        outlines = [silhouette(one, level, close=close, grow=grow) for one in pictures]
        result = visual_hull(tuple(found.rig), outlines, voxels, masks, votes=votes)
        edge = voxels.spacing
        each = zip(found.rig.names, map(_known, result.overlaps), strict=True)
        views: dict[str, float | None] = dict(each)
        report = {
            "iou": _known(result.overlaps.mean()),
            "views": views,
            "threshold": level,
            "voxels_inside": int(result.inside.sum()),
            "volume": float(result.inside.sum() * edge[0] * edge[1] * edge[2]),
            "volume_unit": f"{found.rig.length_unit}^3",
        }
        with whole_folder(out, last=("hull.json",)) as staging:
            for suffix in (".npz", ".vti", ".nrrd"):
                write_volume(
                    staging / f"hull{suffix}", result.inside, voxels, found.rig.length_unit
                )
            (staging / "hull.json").write_text(json_text.dumps(report, indent=2) + "\n", "utf-8")
    worst = min(views.items(), key=lambda one: -1.0 if one[1] is None else one[1])
    said = "undefined" if report["iou"] is None else f"{report['iou']:.4f}"
    say(
        f"hull: {report['voxels_inside']:,} voxels, {report['volume']:.4g} "
        f"{report['volume_unit']}; intersection over union of silhouettes and hull {said}, "
        f"least of {worst[0]}{'' if worst[1] is None else f' ({worst[1]:.4f})'}"
    )
    if json:
        print_json(report)


def _known(value: float) -> float | None:
    """Return a number that JSON can hold."""
    return float(value) if value == value else None
