"""``flametomo calibrate-rig``: a rig from images of a flat target, and how accurate it is."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from tomo.cli.calibration_inputs import (
    CommonLensOption,
    FixedCenterOption,
    IntrinsicsOption,
    LensImagesOption,
    RefineWindowOption,
    SceneOption,
    SquareOption,
    are_mosaics,
    given_lenses,
    given_scene,
    given_volume,
    given_world,
    lens_sets,
)
from tomo.cli.console import JsonFlag, print_json, say
from tomo.cli.errors import bad_input_in_one_line
from tomo.cli.inputs import CenterOption, SpacingOption
from tomo.cli.outputs import check_output_file, check_output_folder

PAGE, FIGURES = "_calibration.html", "_calibration.json"
"""Endings of the two files beside a rig.yaml, whose name they begin with."""

EXAMPLES = """
flametomo calibrate-rig images --target chessboard:9x6:25
    -o rig.yaml
flametomo calibrate-rig poses --intrinsics-images lenses -o rig.yaml
    --target chessboard:9x6:25 --square-pixels --common-lens all
flametomo calibrate-rig images -o rig.yaml --grid 30x140x30
    --spacing 0.5 --target charuco:5x4:54:40.5:DICT_4X4_1000
"""


Images = Annotated[
    Path,
    typer.Argument(
        metavar="IMAGES",
        help="A folder with one folder of images, or one video, for each camera, or with images "
        "CAMERA_NUMBER.*. Images of the same name were taken at the same time.",
    ),
]
TargetOption = Annotated[
    str,
    typer.Option(
        metavar="TARGET",
        help="chessboard:9x6:25 (inner corners, square), circles:7x5:20, acircles:4x11:20 "
        "(spacing) or charuco:5x4:54:40.5:DICT_4X4_1000 (squares, square, marker, "
        "dictionary).",
    ),
]
ModelOption = Annotated[
    str,
    typer.Option(
        metavar="MODEL",
        help="Distortion model: none, radial, brown4, brown5, rational, thin_prism, tilted, "
        "fisheye, or auto, which adds terms that lower the error.",
    ),
]
WorldOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Origin and axes: a camera's name, a frame's name (the target in it), or a YAML "
        "file with the positions of three or more cameras by name. The first camera if "
        "absent.",
    ),
]
CheckedGridOption = Annotated[
    str | None,
    typer.Option(
        metavar="NxNxN",
        help="Voxels to check the rig in, like 30x140x30; stored in the rig.",
        rich_help_panel="Voxel grid",
    ),
]
ReportOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER", help=f"Folder for RIG{PAGE} and RIG{FIGURES}; the rig's if absent."
    ),
]


def calibrate_rig(
    images: Images,
    target: TargetOption,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="The rig.yaml to write.")
    ],
    length_unit: Annotated[
        str, typer.Option(metavar="UNIT", help="Unit of the target's lengths and of the rig.")
    ] = "mm",
    intrinsics: IntrinsicsOption = None,
    intrinsics_images: LensImagesOption = None,
    model: ModelOption = "auto",
    square_pixels: SquareOption = False,
    fixed_center: FixedCenterOption = False,
    common_lens: CommonLensOption = None,
    world: WorldOption = None,
    scene: SceneOption = None,
    refine_window: RefineWindowOption = None,
    rescale: Annotated[
        bool, typer.Option("--rescale", help="Take the scale from the positions in --world.")
    ] = False,
    grid: CheckedGridOption = None,
    spacing: SpacingOption = None,
    center: CenterOption = None,
    report: ReportOption = None,
    pattern: Annotated[
        str | None,
        typer.Option(
            metavar="PATTERN",
            help="How the images are named otherwise, like '{frame}/{camera}.png'.",
        ),
    ] = None,
    bayer: Annotated[
        str | None,
        typer.Option(
            metavar="ORDER",
            help="Images are mosaics of colour filters in this order, like RGGB: the target is "
            "searched in their brightness.",
        ),
    ] = None,
    every: Annotated[
        int, typer.Option(help="Use one picture of a video in this many.", min=1)
    ] = 1,
    cache: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A file that stores the detections for the next run."),
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Calibrate a rig from images of a flat target.

    The target was moved about in front of the cameras. Camera matrices, distortion, camera poses
    and target poses are adjusted together. A page and a JSON file with every figure are written
    next to the rig; the page begins with the assessment.
    """
    started = time.perf_counter()
    with bad_input_in_one_line():
        _check_outputs(out, report, cache)
        from rigs import save_rig
        from rigs.calibrate import calibrate_rig as calibrate
        from rigs.calibrate import image_set, parse_target
        from rigs.calibrate.detect.split_sets import check_not_split
        from rigs.files.json_file import write_json
        from rigs.recordings.layout import cameras_and_frames
        from tomo.draw.calibration import write_calibration_page

        flat, volume = parse_target(target), given_volume(grid, spacing, center)
        axes, strays = given_world(world), list[str]()
        naming = {"pattern": pattern, "are_mosaics": are_mosaics(bayer)}
        if pattern is None:
            check_not_split(images, bool(intrinsics or intrinsics_images))
        found = image_set(images, every, strays.append, **naming)
        if pattern is not None:
            say(cameras_and_frames(found))
        optical, windows = given_scene(scene, refine_window or [], length_unit)
        calibration = calibrate(
            found,
            flat,
            intrinsics=given_lenses(intrinsics or [], found),
            intrinsics_images=intrinsics_images,
            common_lens=lens_sets(common_lens or [], found),
            pattern=pattern,
            bayer=bayer,
            every=every,
            cache=cache,
            progress=True,
            world=axes,
            rescale=rescale,
            length_unit=length_unit,
            distortion=model,
            volume=volume,
            square_pixels=square_pixels,
            fixed_center=fixed_center,
            scene=optical,
            windows=windows,
        )
        calibration = replace(calibration, notes=(*strays, *calibration.notes))
        folder = out.parent if report is None else report
        page = folder / f"{out.stem}{PAGE}"
        seconds = time.perf_counter() - started
        figures = {"target": str(flat), "seconds": round(seconds, 3), **calibration.report()}
        out.parent.mkdir(parents=True, exist_ok=True)
        save_rig(calibration.rig, out)
        write_calibration_page(
            page,
            calibration,
            title=f"Calibration of {images.absolute().name}",
            details={"images": images, "target": flat, "time": f"{seconds:.0f} s"},
        )
        write_json(folder / f"{out.stem}{FIGURES}", figures, indent=2)
    for line in (calibration.assessment, *calibration.notes):
        say(line)
    if json:
        print_json({"rig": str(out), "page": str(page), **figures})


def _check_outputs(out: Path, report: Path | None, cache: Path | None) -> None:
    """Raise unless everything can be written: better now than after the work."""
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise ValueError(f"{out}: suffix: found {out.suffix!r}, expected .yaml")
    check_output_file(out)
    if cache is not None:
        check_output_file(cache)
    if report is not None:
        check_output_folder(report)
