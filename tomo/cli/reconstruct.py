"""``flametomo reconstruct``: the emission in every voxel from the images of a scan."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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

if TYPE_CHECKING:
    from rigs import Rig

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
    rig: Annotated[Path | None, typer.Option(help="Instead of SCAN: a rig.yaml ...")] = None,
    images: Annotated[
        Path | None, typer.Option(help="... and a folder <camera>/<frame>.tif")
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
    margin: Annotated[
        str,
        typer.Option(
            help="Pixels around an empty voxel that must be dark, auto, or inf: none is."
        ),
    ] = "auto",
    dark_level: Annotated[
        str, typer.Option(help="Intensity up to which a pixel is dark, or auto.")
    ] = "auto",
    votes: Annotated[
        str, typer.Option(help="Views that must find a voxel dark, or auto.")
    ] = "auto",
    suspects: Annotated[
        bool,
        typer.Option(
            "--suspects/--keep-suspects",
            help="Exclude outlier pixels, and views that the others contradict.",
        ),
    ] = True,
    align: Annotated[
        bool, typer.Option(help="Shift images that clearly lie beside where the rig says.")
    ] = True,
    refine_cameras: Annotated[
        str | None,
        typer.Option(
            help="Refine cameras from the images, kept if rays held out improve: "
            "CAMERA,CAMERA ..., all, or nominal (those whose status is)."
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
    weigh: Annotated[
        bool,
        typer.Option(help="Weigh pixels by their noise, where it differs, in auto and wernet."),
    ] = True,
    blur: Annotated[
        str,
        typer.Option(
            help="Diameter at the grid's centre of the discs that lenses out of focus make of "
            "points, in the rig's length unit; 0: in focus; auto: found in the images."
        ),
    ] = "0",
    basis: Annotated[
        str,
        typer.Option(
            help="What is solved for: boxes of even emission, splines that run straight between "
            "the voxels' centres, or auto: what predicts left-out views better."
        ),
    ] = "auto",
    unseen: Annotated[
        str, typer.Option(help="What stands where no ray crosses a voxel: zero or nan.")
    ] = "zero",
    device: Annotated[str, typer.Option(help="For WERNet: cpu, cuda ...")] = "cpu",
    encoder: Annotated[
        str | None, typer.Option(help="For WERNet: start from an encoder's file or name.")
    ] = None,
    freeze_encoder: Annotated[
        bool, typer.Option("--freeze-encoder", help="Use the encoder as it is.")
    ] = False,
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
        from tomo.pipeline import reconstruct as run
        from tomo.report.outcome_files import write_outcome

        comparisons = [_comparison(text) for text in compare or ()]
        loaded = _load(scan, rig, images).scaled(scale)
        check_output_volume(out, loaded.rig, loaded.source)
        asked = any(option is not None for option in (grid, spacing, center, lower, upper))
        voxels = (
            parse_grid(grid, spacing, center, lower, upper, default=loaded.grid) if asked else None
        )
        with progress_bar("reconstruct") as progress:
            outcome = run(
                loaded,
                voxels,
                method=method,
                frame=frame,
                hold_out=tuple(hold_out or ()),
                iterations=iterations,
                compare=comparisons,
                tracer=tracer,
                projector=projector,
                skip=skip,
                margin=_number_or_auto("--margin", margin, float),
                dark_level=_number_or_auto("--dark-level", dark_level, float),
                votes=_number_or_auto("--votes", votes, int),
                suspects=suspects,
                align=align,
                refine_cameras=_cameras(refine_cameras, loaded.rig),
                refine_prior=refine_prior,
                fit_gain=fit_gain,
                weigh=weigh,
                blur=_number_or_auto("--blur", blur, float),
                basis=basis,
                unseen=unseen,
                supersample=supersample,
                device=device,
                encoder=encoder,
                freeze_encoder=freeze_encoder,
                checkpoint=_checkpoint(out, method, resume),
                resume=resume,
                seed=seed,
                time_limit=time_limit,
                uncertainty=_number_or_auto("--uncertainty", uncertainty, int),
                progress=progress,
            )
        report = write_outcome(out, outcome)
    for warning in report["warnings"]:
        say(f"warning: {warning}", "yellow")
    say(_summary(report, out))
    if json:
        print_json(report)


def _load(scan: Path | None, rig: Path | None, images: Path | None) -> object:
    from tomo import Scan

    if scan is not None and rig is None and images is None:
        return Scan.load(scan)
    if scan is None and rig is not None and images is not None:
        return Scan.from_images(rig, images)
    raise ValueError("SCAN: expected either a scan, or --rig and --images together")


def _checkpoint(out: Path, method: str, resume: bool) -> Path | None:
    """Return where WERNet keeps the state of its training; None for other methods."""
    if method == "wernet":
        return out / "checkpoint.pt"
    if resume:
        raise ValueError(f"--resume: found it with method {method}, expected wernet")
    return None


def _cameras(text: str | None, rig: Rig) -> list[str] | None:
    """Return the names of the cameras to refine; None where that is not asked for."""
    if text is None:
        return None
    if text == "all" and text not in rig.names:
        return list(rig.names)
    if text == "nominal" and text not in rig.names:
        names = [camera.name for camera in rig if camera.status == "nominal"]
        if not names:
            raise ValueError("--refine-cameras: found no nominal camera in the rig, expected some")
        return names
    return [name.strip() for name in text.split(",")]


def _number_or_auto(option: str, text: str, kind: type) -> float | str:
    """Return the number of an option, or auto."""
    try:
        return text if text == "auto" else kind(text)
    except ValueError:
        what = "a whole number" if kind is int else "a number"
        raise ValueError(f"{option}: found {text!r}, expected auto or {what}") from None


def _comparison(text: str) -> tuple[str, int | None]:
    """Return method and iterations of ``METHOD[:ITERATIONS]``."""
    match = re.fullmatch(r"([\w-]+)(?::(\d{1,6}))?", text, re.ASCII)
    if match is None:
        raise ValueError(f"--compare: found {text!r}, expected METHOD or METHOD:ITERATIONS")
    return match[1], int(match[2]) if match[2] else None


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
