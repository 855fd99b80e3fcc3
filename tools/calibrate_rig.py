"""Calibrate a rig from images of a flat target; say how far it can be trusted, and why."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from _command import (
    bad_input_in_one_line,
    check_output_file,
    check_output_folder,
    console,
    load_rig_or_preset,
    parse_grid,
    print_json,
    progress_bar,
)

if TYPE_CHECKING:
    import numpy as np

    from rigs import Volume
    from rigs.calibrate import Calibration
    from rigs.calibrate.detect import Detections
    from rigs.calibrate.detect.detect import ImageSet

from _usage import OneLineUsage

app = typer.Typer(add_completion=False)

PAGE, FIGURES = "calibration.html", "calibration.json"
_NAMED = 6


@app.command(cls=OneLineUsage)
def calibrate_rig(
    images: Annotated[
        Path,
        typer.Argument(
            help="A folder with one folder of images, or one video, a camera; images of equal "
            "name were taken at one moment."
        ),
    ],
    target: Annotated[
        str,
        typer.Option(
            help="charuco:5x4:0.054:0.0405:DICT_4X4_1000, chessboard:9x6:1.0 (inner corners), "
            "circles:7x5:0.02 or acircles:4x11:0.02."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="The rig.yaml to write.")],
    length_unit: Annotated[
        str, typer.Option(help="Of the target's lengths, and so of the rig.")
    ] = "mm",
    intrinsics: Annotated[
        str | None, typer.Option(help="A rig whose cameras' lenses are kept as they are.")
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="The lenses: none, radial, brown4, brown5, rational, thin_prism, tilted, "
            "fisheye; auto frees the terms that pay."
        ),
    ] = "auto",
    world: Annotated[
        str | None,
        typer.Option(
            help="A camera's or a frame's name: its axes, or those of the target in it; or a YAML "
            "file with the positions of three or more, by name. The first camera's when absent."
        ),
    ] = None,
    rescale: Annotated[
        bool, typer.Option("--rescale", help="Positions in --world set the scale.")
    ] = False,
    grid: Annotated[
        str | None,
        typer.Option(help="Voxels to judge the rig in, like 30x140x30, kept in the rig."),
    ] = None,
    spacing: Annotated[
        str | None, typer.Option(help="A voxel's edge lengths: 0.5 or 0.5,0.5,1.")
    ] = None,
    center: Annotated[str | None, typer.Option(help="The middle of the grid: x,y,z.")] = None,
    report: Annotated[
        Path | None,
        typer.Option(help=f"Folder for {PAGE} and {FIGURES}; that of the rig when absent."),
    ] = None,
    every: Annotated[int, typer.Option(help="Take every so many pictures of a video.", min=1)] = 1,
    cache: Annotated[
        Path | None, typer.Option(help="A file that keeps what was detected for the next time.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Calibrate a rig from images of a flat target that was moved about in front of it.

    Lenses, camera poses and target poses are adjusted together. Beside the rig stand a page and
    a file with every figure; the assessment comes first.
    """
    started = time.perf_counter()
    with bad_input_in_one_line():
        _check_outputs(out, report, cache)
        from rigs import save_rig
        from rigs.calibrate import calibrate
        from rigs.calibrate.detect import detections, image_set
        from rigs.calibrate.options import check_options
        from rigs.calibrate.targets import parse_target
        from rigs.files.json_file import write_json

        described = parse_target(target)
        volume = _volume(grid, spacing, center)
        given = load_rig_or_preset(intrinsics) if intrinsics else None
        names = _world(world)
        found = image_set(images, every)
        check_options(
            found,
            {frame for of_camera in found.values() for frame in of_camera},
            intrinsics=given,
            world=names,
            rescale=rescale,
            length_unit=length_unit,
            distortion=model,
            target=described,
        )
        with progress_bar("detect") as progress:
            seen = detections(found, described, cache=cache, progress=progress)
        with console.status("calibrate") as status:
            calibration = calibrate(
                seen.observations,
                intrinsics=given,
                world=names,
                rescale=rescale,
                length_unit=length_unit,
                distortion=model,
                target=described,
                volume=volume,
                progress=status.update,
            )
        notes = _notes(found, seen)
        seconds = time.perf_counter() - started
        out.parent.mkdir(parents=True, exist_ok=True)
        save_rig(calibration.rig, out)
        details = {"images": images, "target": described, "time": f"{seconds:.0f} s"}
        folder = out.parent if report is None else report
        _write_page(folder / PAGE, calibration, found, notes, details)
        figures = {
            "target": str(described),
            "length_unit": length_unit,
            "seconds": round(seconds, 3),
            "notes": notes,
            **_figures(calibration),
        }
        write_json(folder / FIGURES, figures, indent=2)
    for line in (calibration.assessment, *notes):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
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


def _volume(grid: str | None, spacing: str | None, center: str | None) -> Volume | None:
    """Return the voxels that options describe; None where there are none."""
    if grid is None and spacing is None and center is None:
        return None
    from rigs import Volume

    voxels = parse_grid(grid, spacing, center)
    return Volume(voxels.shape, voxels.spacing, voxels.center)


def _world(text: str | None) -> Any:
    """Return a name as it is, and the positions in a file."""
    if text is None or Path(text).suffix.lower() not in (".yaml", ".yml"):
        return text
    from rigs.files.text import read_yaml_mapping
    from rigs.geometry.rotation import numbers

    positions = read_yaml_mapping(text)
    return {name: numbers(point, (3,), f"{text}: {name}") for name, point in positions.items()}


def _notes(found: ImageSet, seen: Detections) -> list[str]:
    """Return lines on images that are blurred, and on cameras whose images lack the target."""
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
    return notes


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
