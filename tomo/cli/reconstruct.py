"""``flametomo reconstruct``: the emission in every voxel from the images of a scan."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rigs.progress import progress_of, staged
from tomo.cli.console import print_json, say, typed
from tomo.cli.images import Corrections, Images
from tomo.cli.inputs import Box, check_output_store, check_output_volume
from tomo.cli.stopping import keep
from tomo.pipeline.declared import whole
from tomo.pipeline.options import Options

if TYPE_CHECKING:
    from tomo import Scan, VoxelGrid
    from tomo.report import Ahead

EXAMPLES = """
flametomo reconstruct scan -o out
flametomo reconstruct scan -o out --hold-out cam02
flametomo reconstruct scan -o out --method sirt --iterations 100
flametomo reconstruct --rig rig.yaml --images images
    --grid 30x140x30 --spacing 0.5 -o out
    --dark dark --bit-depth 12
flametomo reconstruct scan -o out --bayer RGGB --channel g
flametomo reconstruct scan --frames 0:1000:2 -o out.zarr
"""


FIRST = ("out", "rig", "images", "grid", "spacing", "method")


def reconstruct(
    scan: Path | None = None,
    /,
    *,
    out: Path,
    images: Images,
    scale: Annotated[int, whole(1)] = 1,
    options: Options,
    workers: int | None = None,
    scheduler: str | None = None,
    box: Box,
    corrections: Corrections,
    preview: bool = False,
    pictures: bool = True,
    json: bool = False,
) -> None:
    """Reconstruct the emission in every voxel from a scan's images.

    Writes a preview first and then the volume (.npz, .vti, .nrrd), report.html, report.json and
    pictures; interrupted, it leaves what it has said to be complete. With --frames, a
    store of volumes (Zarr) with figures for each frame, and OUT_report.html; the same command goes
    on with one that was interrupted.

    Parameters
    ----------
    out : FOLDER
        The folder to write; with --frames the store, OUT.zarr.
    preview :
        Stop at the preview: a coarse volume and its picture, in seconds.
    pictures :
        Draw the report's pictures.

    Images
    ------
    scale : N
        Shrink the images by area means; in Python scan.scaled(N).

    Frames and films
    ----------------
    workers : N
        With --frames: solve blocks of frames in N processes of one thread each.
    scheduler : ADDRESS
        With --frames: solve blocks of frames on the Dask cluster at an address like
        tls://host:8786; by tcp:// everybody in its network can run programs on it.
    """
    loaded = corrections.of(images.scan(scan)).scaled(scale)
    if options.frames is None:
        for name, value in (("workers", workers), ("scheduler", scheduler)):
            if value is not None:
                raise ValueError(f"--{name}: found {value}, expected it with --frames alone")
        check_output_volume(out, loaded.rig, loaded.source)
    voxels = box.voxels(loaded.grid) if box or loaded.grid is None else None
    _say_scale(loaded, voxels or loaded.grid)
    if options.frames is not None:
        if preview:
            raise ValueError("--preview: found it with --frames, expected one of both")
        from tomo.series import on_cluster

        is_shared = workers is not None or scheduler is not None
        cluster = on_cluster(workers, scheduler) if is_shared else None
        return _series(loaded, voxels, options, out, pictures, json, cluster)
    report = (_previewed if preview else _whole)(loaded, voxels, options, out, pictures)
    if preview:
        return print_json(report) if json else None
    _tell(report, _summary(report, out), json)


def _tell(report: dict[str, Any], summary: str, json: bool) -> None:
    """Say the answer, the warnings and a summary."""
    say(report["answer"]["sentence"], "bold")
    for warning in report["warnings"]:
        say(f"warning: {warning}", "yellow")
    say(summary)
    if json:
        print_json(report)


def _whole(
    scan: Scan, grid: VoxelGrid | None, options: Options, out: Path, pictures: bool
) -> dict[str, Any]:
    """Reconstruct one frame; return its report."""
    from tomo import reconstruct as run

    with _ahead(out, pictures) as ahead, progress_of(True, "reconstruct") as tell:
        outcome = run(scan, grid, options, progress=tell, early=ahead)
        return ahead.save(outcome, typed(), staged(tell)("pictures"))


def _previewed(
    scan: Scan, grid: VoxelGrid | None, options: Options, out: Path, pictures: bool
) -> dict[str, Any]:
    """Make the preview alone; return its report."""
    from tomo import preview

    with _ahead(out, pictures) as ahead:
        outcome = preview(scan, grid, options, progress=True)
        picture = ahead.preview(outcome)
        if picture:
            picture.result()
        return outcome.report()


@contextmanager
def _ahead(out: Path, pictures: bool) -> Iterator[Ahead]:
    """Give what writes and says what is known early, with a process to draw in."""
    from tomo.report import Ahead, Artist

    with Artist() if pictures else nullcontext() as artist:
        yield Ahead(out, say, artist, keep)


def _say_scale(scan: Scan, grid: VoxelGrid | None) -> None:
    """Say that smaller images would do, where check-rig says so."""
    from rigs.check import scale_for

    found = None if grid is None else scale_for(scan.rig, grid)
    if found is not None:
        pixels, times = found
        say(
            f"note: a voxel is {pixels:.0f} pixels wide: --scale {times * scan.shrink} loses "
            f"little and has {times**2} times fewer pixels"
        )


def _series(
    scan: Scan,
    grid: VoxelGrid | None,
    options: Options,
    out: Path,
    pictures: bool,
    json: bool,
    cluster: AbstractContextManager | None,
) -> None:
    """Reconstruct frames into a store, and say what became of them."""
    from tomo.report import write_series_outcome
    from tomo.series import reconstruct_series

    check_output_store(out, scan.rig, scan.source)
    store = reconstruct_series(scan, out, grid, options, progress=True, cluster=cluster)
    report = write_series_outcome(store, scan, with_film=pictures, progress=True)
    _tell(report, _series_summary(report), json)


def _series_summary(report: dict) -> str:
    """Return a line on each of: the frames, held-out cameras, the verdict, the store."""
    from tomo.pipeline.view import peak_in_words, with_unit

    figures = (
        ("relative_residual", "mean relative residual {:.4g}"),
        ("seconds_a_frame", "{:.2f} s a frame"),
    )
    known = [words.format(report[name]) for name, words in figures if report[name] is not None]
    lines = [", ".join([f"{report['complete']} of {report['frames']} frames", *known])]
    compared = {"against the truth": report["quality"]} if report["quality"] else {}
    compared |= {f"held out {camera}": each for camera, each in report["held_out"].items()}
    for who, figures in compared.items():
        shown = ", ".join(
            f"{name} {with_unit(name, f'{value:.4g}')}" for name, value in figures.items()
        )
        shown += f", peak {peak_in_words(report['plan']['peak'])}" if "psnr" in figures else ""
        lines.append(f"{who}, mean: {shown}")
    lines.append(report["verdict"]["sentence"])
    lines.append(
        f"open {report['page']}; {report['store']} opens with xarray.open_zarr, and flametomo "
        "export writes it for other programs"
    )
    return "\n".join(lines)


def _summary(report: dict, out: Path) -> str:
    """Return a line on each of: the fit, the error, held-out cameras, the verdict, the page."""
    lines = [
        f"{report['method']}: relative residual {_number(report['relative_residual'])}, "
        f"{report['rays']:,} rays, {report['segments']:,} segments, "
        f"solved in {report['seconds']['solve']:.1f} s of {report['seconds']['total']:.1f} s"
    ]
    if report["quality"]:
        lines.append(f"against the truth: {_figures(report['quality'])}")
    if report["gains"]:
        lines.append(_of_gains(report["gains"]))
    for camera, figures in report["held_out"].items():
        lines.append(f"held out {camera}: {_prediction(figures, report)}")
    if report["comparisons"]:
        lines += _comparison(report)
    said = "\n".join(report["warnings"])
    more = [f"- {one}" for one in report["verdict"]["reasons"][1:] if one not in said]
    lines += [report["verdict"]["sentence"], *more, f"open {out / 'report.html'}"]
    return "\n".join(lines)


def _of_gains(gains: dict) -> str:
    """Return the range of the gains that images were divided by, and the largest error."""
    lowest, highest = (pick(gains["gain"], key=gains["gain"].get) for pick in (min, max))
    known = [one for one in gains["gain_error"].values() if one is not None]
    errors = f", each to {max(known):.4f} or better" if known else ""
    return (
        f"images divided by gains of {gains['gain'][lowest]:.3f} ({lowest}) to "
        f"{gains['gain'][highest]:.3f} ({highest}){errors}: report.json, gains"
    )


def _prediction(figures: dict, report: dict) -> str:
    """Return the figures of a held-out camera with their peak, and with its level fitted."""
    from tomo.pipeline.view import peak_in_words

    names = ("psnr", "ssim", "cosine")
    said = f"{_figures({n: figures.get(n) for n in names})}, peak {peak_in_words(report['peak'])}"
    said, own = said + _of_used(report["views"]), figures["fitted"]
    if own is not None:
        level = f"{_number(own['background'])} {report['peak']['unit']}"
        said += f"; gain {_number(own['gain'])} and background {level} "
        said += f"fitted: {_figures({n: own.get(n) for n in names})}"
    return said


def _of_used(views: dict) -> str:
    """Return the PSNR of the cameras used, to compare that of a held-out camera with."""
    used = [v["psnr"] for v in views.values() if not (v["held_out"] or v["excluded"])]
    known = [one for one in used if one is not None]
    if not known:
        return ""
    return f" (cameras used: psnr {_number(min(known))} to {_number(max(known))} dB)"


def _comparison(report: dict) -> list[str]:
    """Return a table of the methods; held-out figures are means, residuals of cameras used."""
    heads = ["method", "held-out psnr (dB)", "held-out ssim", "nrmse", "residual", "seconds"]
    rows = []
    for one in (report, *report["comparisons"]):
        held_out = one["held_out"].values()
        alike = [_mean(figures.get(name) for figures in held_out) for name in ("psnr", "ssim")]
        seconds = one["seconds"]["solve" if one is report else "total"]
        error = one["quality"].get("nrmse")
        rows.append([one["method"], *alike, error, one["relative_residual"], seconds])
    columns: list[list[str]] = []
    for head, *values in zip(heads, *rows, strict=True):
        if any(value is not None for value in values):
            texts = [v if isinstance(v, str) else _number(v, "-") for v in (head, *values)]
            width = max(map(len, texts))
            columns.append([one.rjust(width) if columns else one.ljust(width) for one in texts])
    return list(map("  ".join, zip(*columns, strict=True)))


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def _figures(figures: dict) -> str:
    from tomo.pipeline.view import with_unit

    return ", ".join(f"{name} {with_unit(name, _number(v))}" for name, v in figures.items())


def _number(value: float | None, unknown: str = "undefined") -> str:
    """Return a figure of the report, where None stands for what is no finite number."""
    return unknown if value is None else f"{value:.4g}"
