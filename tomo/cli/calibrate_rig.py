"""``flametomo calibrate-rig``: a rig from images of a flat target, and how accurate it is."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    cameras_images,
    check_lens_options,
    frame_names,
    given_lenses,
    given_scene,
    given_volume,
    given_world,
    lens_sets,
    with_lens_images,
)
from tomo.cli.console import JsonFlag, console, print_json, progress_bar, say
from tomo.cli.errors import bad_input_in_one_line
from tomo.cli.inputs import CenterOption, SpacingOption
from tomo.cli.outputs import check_output_file, check_output_folder

if TYPE_CHECKING:
    import numpy as np

    from rigs.calibrate import Calibration
    from rigs.calibrate.detect import Detections
    from rigs.calibrate.detect.detect import ImageSet


PAGE, FIGURES = "calibration.html", "calibration.json"
_NAMED = 6

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
    typer.Option(metavar="FOLDER", help=f"Folder for {PAGE} and {FIGURES}; the rig's if absent."),
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
        from rigs.calibrate import calibrate, frame_times
        from rigs.calibrate.detect import detections
        from rigs.calibrate.options import check_options
        from rigs.calibrate.targets import parse_target
        from rigs.files.json_file import write_json

        notes: list[str] = []
        target_seen, volume = parse_target(target), given_volume(grid, spacing, center)
        axes = given_world(world)
        naming = {"pattern": pattern, "are_mosaics": are_mosaics(bayer)}
        found = cameras_images(images, every, notes, **naming)
        how = {
            "intrinsics": given_lenses(intrinsics or [], found),
            "world": axes,
            "rescale": rescale,
            "length_unit": length_unit,
            "distortion": model,
            "target": target_seen,
        }
        how["scene"], windows = given_scene(scene, refine_window or [], length_unit)
        frames = frame_names(found)
        check_options(found, frames, **how)
        lenses = {
            "square_pixels": square_pixels,
            "fixed_center": fixed_center,
            "common_lens": lens_sets(common_lens or [], found),
        }
        check_lens_options(found, intrinsics, intrinsics_images, lenses)
        times = frame_times(frames)
        if intrinsics_images is not None:
            own = cameras_images(intrinsics_images, every, notes, **naming)
            found = with_lens_images(found, own, intrinsics_images)
        with progress_bar("detect") as progress:
            seen = detections(found, how["target"], cache=cache, progress=progress)
        with console.status("calibrate") as status:
            calibration = calibrate(
                seen.observations,
                **how,
                **lenses,
                windows=windows,
                times=times,
                volume=volume,
                progress=status.update,
            )
        notes += _notes(found, seen)
        folder = out.parent if report is None else report
        seconds = time.perf_counter() - started
        details = {"images": images, "target": how["target"], "time": f"{seconds:.0f} s"}
        figures = {
            "target": str(how["target"]),
            "length_unit": length_unit,
            "seconds": round(seconds, 3),
            "notes": notes,
            **_figures(calibration),
        }
        out.parent.mkdir(parents=True, exist_ok=True)
        save_rig(calibration.rig, out)
        _write_page(folder / PAGE, calibration, found, notes, details)
        write_json(folder / FIGURES, figures, indent=2)
    for line in (calibration.assessment, *notes):
        say(line)
    if json:
        print_json({"rig": str(out), "page": str(folder / PAGE), **figures})


def _check_outputs(out: Path, report: Path | None, cache: Path | None) -> None:
    """Raise unless everything can be written: better now than after the work."""
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise ValueError(f"{out}: suffix: found {out.suffix!r}, expected .yaml")
    check_output_file(out)
    if cache is not None:
        check_output_file(cache)
    if report is not None:
        check_output_folder(report)


def _notes(found: ImageSet, seen: Detections) -> list[str]:
    """Return lines on files, blurred images, and cameras whose images lack the target."""
    from rigs.calibrate.detect.image_sets import notes_of

    notes = [
        f"camera {camera}: {found[camera][frame]}: edges are blurred over {blur:.2g} px, twice as "
        "much as is usual or more"
        for camera, frame, blur in seen.blurred()
    ]
    for camera, frames in found.items():
        without = [frame for frame in frames if (camera, frame) in seen.reasons]
        if without:
            named = ", ".join(without[:_NAMED]) + (", ..." if len(without) > _NAMED else "")
            notes.append(
                f"camera {camera}: target not found in {len(without)} of {len(frames)} images: "
                f"{named}"
            )
    return notes + notes_of(found)


def _write_page(
    path: Path,
    calibration: Calibration,
    found: ImageSet,
    notes: list[str],
    details: dict[str, Any],
) -> None:
    """Write the page, with the images that fit worst."""
    from rigs.calibrate.detect.image_sets import read_source
    from tomo.draw.calibration import write_calibration_page

    def image_of(camera: str, frame: str) -> np.ndarray:
        return read_source(found[camera][frame])

    title = f"Calibration of {Path(details['images']).absolute().name}"
    write_calibration_page(
        path, calibration, title=title, image_of=image_of, notes=notes, details=details
    )


def _figures(calibration: Calibration) -> dict[str, Any]:
    """Return every figure of the calibration as plain data, and what was left out."""
    import numpy as np

    from rigs.files.json_file import plain

    observations, quality = calibration.observations, calibration.quality
    left_out = np.flatnonzero(~calibration.used)
    figures = {
        **(calibration.rig.calibration or {}),
        "frames_rms_px": dict(zip(observations.frames, quality.frame_rms, strict=True)),
        "images_rms_px": {
            camera: {
                frame: rms
                for frame, rms in zip(observations.frames, row, strict=True)
                if math.isfinite(rms)
            }
            for camera, row in zip(observations.cameras, quality.image_rms, strict=True)
        },
        "left_out": [
            {
                "camera": observations.cameras[observations.camera[k]],
                "frame": observations.frames[observations.frame[k]],
                "point": int(observations.point[k]),
                "uv": list(observations.uv[k]),
                "residual_px": list(calibration.residuals[k]),
            }
            for k in left_out
        ],
    }
    return plain(figures, digits=6)
