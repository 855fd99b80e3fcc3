"""``flametomo reconstruct``: the emission in every voxel from the images of a scan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tomo.cli.console import JsonFlag, print_json, progress_bar, say
from tomo.cli.errors import bad_input_in_one_line
from tomo.cli.inputs import (
    CenterOption,
    GridOption,
    LowerOption,
    SpacingOption,
    UpperOption,
    parse_grid,
)
from tomo.cli.outputs import check_output_volume

EXAMPLES = """
flametomo reconstruct scan -o out
flametomo reconstruct scan -o out --hold-out cam02
flametomo reconstruct --rig rig.yaml --images images
    --grid 30x140x30 --spacing 0.5 -o out
"""


def reconstruct(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")],
    scan: Annotated[
        Path | None, typer.Argument(help="A scan folder, scan.yaml or transforms.json.")
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="A rig.yaml, with --images, in place of SCAN.")
    ] = None,
    images: Annotated[
        Path | None, typer.Option(help="A folder CAMERA/FRAME.tif, with --rig.")
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            help="auto, art, cgls, curvature, mart, mlem, nnls, sart, sirt, smart, tikhonov, tv, "
            "wernet, wernet-paper"
        ),
    ] = "auto",
    grid: GridOption = None,
    spacing: SpacingOption = None,
    center: CenterOption = None,
    lower: LowerOption = None,
    upper: UpperOption = None,
    frame: Annotated[str | None, typer.Option(help="The moment; the first if absent.")] = None,
    hold_out: Annotated[
        list[str] | None, typer.Option(help="A camera to predict only; may be repeated.")
    ] = None,
    scale: Annotated[int, typer.Option(help="Shrink images by area means.", min=1)] = 1,
    iterations: Annotated[int | None, typer.Option(help="Of the method.", min=0)] = None,
    compare: Annotated[
        list[str] | None, typer.Option(help="METHOD[:ITERATIONS] beside it; may be repeated.")
    ] = None,
    supersample: Annotated[int, typer.Option(help="K x K rays a pixel.", min=1, max=64)] = 1,
    tracer: Annotated[str, typer.Option(help="march, raycast or reference.")] = "march",
    projector: Annotated[
        str, typer.Option(help="auto, stored (fastest) or on-the-fly (little memory).")
    ] = "auto",
    skip: Annotated[bool, typer.Option(help="Leave out what cannot matter.")] = True,
    carving: Annotated[
        str, typer.Option(help="Margin in pixels around an empty voxel, auto, or off.")
    ] = "auto",
    screen: Annotated[
        bool, typer.Option(help="Exclude outlier pixels, and views that the others contradict.")
    ] = True,
    align: Annotated[
        bool, typer.Option(help="Shift images that clearly lie beside where the rig says.")
    ] = True,
    refine_cameras: Annotated[
        str | None,
        typer.Option(
            help="Refine cameras from the images, kept if rays held out improve: "
            "names with commas, all, or nominal (those whose status is)."
        ),
    ] = None,
    refine_prior: Annotated[
        float | None,
        typer.Option(help="Pixels they may be off; from status and calibration if absent."),
    ] = None,
    fit_gain: Annotated[
        bool | None,
        typer.Option(
            "--fit-gain/--no-fit-gain",
            help="Fit each camera's gain and offset; by default when the views disagree.",
        ),
    ] = None,
    pixel_weights: Annotated[
        bool,
        typer.Option(help="Weigh pixels by their noise, where it differs, in auto and wernet."),
    ] = True,
    blur: Annotated[
        float,
        typer.Option(
            help="Diameter at the grid's centre of the discs that lenses out of focus make of "
            "points, in the rig's length unit; 0: in focus."
        ),
    ] = 0.0,
    basis: Annotated[
        str,
        typer.Option(
            help="What is solved for: voxel (constant emission), linear (between the voxels' "
            "centres), or auto: what predicts left-out views better."
        ),
    ] = "auto",
    unseen: Annotated[
        str, typer.Option(help="What stands where no ray crosses a voxel: zero or nan.")
    ] = "zero",
    device: Annotated[str, typer.Option(help="For WERNet: cpu or cuda.")] = "cpu",
    encoder: Annotated[
        str | None, typer.Option(help="For WERNet: start from an encoder's file or name.")
    ] = None,
    freeze_encoder: Annotated[
        bool, typer.Option("--freeze-encoder", help="Use the encoder as it is.")
    ] = False,
    save_encoder: Annotated[
        str | None, typer.Option(help="For WERNet: write the trained encoder.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with WERNet where OUT/checkpoint.pt stopped.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Of everything random.", min=0)] = 0,
    time_limit: Annotated[
        float | None, typer.Option(help="Seconds for the solver, once auto has chosen.")
    ] = None,
    uncertainty: Annotated[
        str,
        typer.Option(
            help="Repeats with new noise, for every voxel's standard deviation: 30 map it, 0 is "
            "none, auto a few for the figures after method auto."
        ),
    ] = "auto",
    json: JsonFlag = False,
) -> None:
    """Reconstruct the emission in every voxel from a scan's images.

    Writes the volume (.npz, .vti, .nrrd), report.html, report.json and pictures.
    """
    with bad_input_in_one_line():
        from tomo.pipeline import Options
        from tomo.pipeline import reconstruct as run
        from tomo.report.outcome_files import write_outcome

        loaded = _load(scan, rig, images).scaled(scale)
        check_output_volume(out, loaded.rig, loaded.source)
        options = Options(
            method=method,
            frame=frame,
            hold_out=tuple(hold_out or ()),
            iterations=iterations,
            compare=tuple(compare or ()),
            tracer=tracer,
            projector=projector,
            skip=skip,
            carving=carving,
            screen=screen,
            align=align,
            refine_cameras=refine_cameras,
            refine_prior=refine_prior,
            fit_gain=fit_gain,
            pixel_weights=pixel_weights,
            blur=blur,
            basis=basis,
            unseen=unseen,
            supersample=supersample,
            device=device,
            encoder=encoder,
            freeze_encoder=freeze_encoder,
            save_encoder=save_encoder,
            checkpoint=str(out / "checkpoint.pt") if method == "wernet" else None,
            resume=resume,
            seed=seed,
            time_limit=time_limit,
            uncertainty=uncertainty,
        )
        asked = any(option is not None for option in (grid, spacing, center, lower, upper))
        voxels = (
            parse_grid(grid, spacing, center, lower, upper, default=loaded.grid) if asked else None
        )
        with progress_bar("reconstruct") as progress:
            outcome = run(loaded, voxels, options, progress=progress)
        report = write_outcome(out, outcome)
    for warning in report["warnings"]:
        say(f"warning: {warning}", "yellow")
    say(_summary(report, out))
    if json:
        print_json(report)


def _load(scan: Path | None, rig: Path | None, images: Path | None) -> object:
    from tomo import load_scan, scan_of_images

    if scan is not None and rig is None and images is None:
        return load_scan(scan)
    if scan is None and rig is not None and images is not None:
        return scan_of_images(rig, images)
    raise ValueError("SCAN: expected either a scan, or --rig and --images together")


def _summary(report: dict, out: Path) -> str:
    """Return the headline: what was done, how well it fits, and where it is."""
    lines = [
        f"{report['method']}: relative residual {_number(report['relative_residual'])}, "
        f"{report['rays']:,} rays, {report['segments']:,} crossings, "
        f"solved in {report['seconds']['solve']:.1f} s of {report['seconds']['total']:.1f} s"
    ]
    if report["quality"]:
        lines.append(_figures(report["quality"]))
    for camera, figures in report["held_out"].items():
        shown = {name: value for name, value in figures.items() if name != "data_range"}
        lines.append(f"held out {camera}: {_figures(shown)}")
    lines.append(f"open {out / 'report.html'}")
    return "\n".join(lines)


def _figures(figures: dict) -> str:
    return ", ".join(f"{name} {_number(value)}" for name, value in figures.items())


def _number(value: float | None) -> str:
    """Return a figure of the report, where None stands for what is no finite number."""
    return "undefined" if value is None else f"{value:.4g}"
