"""One reconstruction: its stages in their order, each a function from values to a value.

A preview goes through the same stages, with larger pixels and voxels and nothing looked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, cast

from rigs import Rig
from rigs.progress import Progress, progress_of
from tomo.grid import VoxelGrid
from tomo.pipeline.assemble import Stages, assemble
from tomo.pipeline.assess import Assessed, assess
from tomo.pipeline.check_options import (
    cameras_to_refine,
    check_cameras,
    check_options,
)
from tomo.pipeline.coarse import RAYS, SEGMENTS, factor_of
from tomo.pipeline.evaluate import Evaluated, Reference, counted, evaluate, read_reference
from tomo.pipeline.first_use import warm_up_stages
from tomo.pipeline.load import LoadedScan, load
from tomo.pipeline.options import Options
from tomo.pipeline.prepare import INFERENCE, prepare
from tomo.pipeline.reconstruction import Reconstruction
from tomo.pipeline.solve import SOLVE, Compared, compare, solve, with_own_absorption
from tomo.pipeline.stage import Pace, Record, as_warning
from tomo.pipeline.view import peak_of
from tomo.scan import Scan
from tomo.scan.downsample import coarser_grid, coarser_images
from tomo.scan.files import as_scan

TRUST = "how far to trust it"

PREVIEW, VOLUME, IMAGES = "preview", "volume", "images"
"""What is known before the rest: a preview, the volume, and the images that it predicts."""

Early = Callable[[str, Reconstruction], None]
"""Called with `PREVIEW`, `VOLUME` and `IMAGES`, and with what is known by then."""

STAGES = (
    "pixels", INFERENCE, "empty voxels", "tracing", "basis and weights", "smoothness", SOLVE,
    "predicted images", TRUST,
)  # fmt: skip
"""Those of every reconstruction once its images are read, in their order."""

_KEPT = ("frame", "hold_out", "peak", "basis", "blur", "absorption", "skip", "carving")
"""Options that a preview has as they are."""


def reconstruct(
    scan: Scan | str | PathLike | Mapping[str, Any],
    grid: VoxelGrid | None = None,
    options: Options = Options(),
    *,
    rig: Rig | str | PathLike | None = None,
    progress: Progress | bool | None = None,
    early: Early | None = None,
    **asked: Any,
) -> Reconstruction:
    """Reconstruct the emission in every voxel from one frame of a scan.

    Parameters
    ----------
    scan : Scan, path-like, or mapping
        Also the path of one; or with ``rig`` a folder of images, or camera to image ``(h, w)``.
    grid : VoxelGrid, optional
        The scan's own when None.
    options : Options
        Everything that can be asked; the default serves most scans.
    rig : Rig or path-like, optional
        The cameras of images.
    progress : bool or callable, optional
        True shows a bar; ``progress(done, total, where)`` is called, see `rigs.progress`.
    early : callable, optional
        ``early(step, outcome)`` is called with what is known before the rest: ``"preview"``, see
        `preview`; ``"volume"``, before other methods are compared; ``"images"``, with predicted
        images, before the uncertainty is found. With it a time left is told to ``progress``.
    **asked
        Single options, such as ``method="mlem"``, in place of those of ``options``.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    options, scan = options.but(**asked), as_scan(scan, rig, grid)
    with progress_of(progress, "reconstruct") as tell:
        pace = Pace(tell)
        outcome = _reconstruct(scan, grid, options, pace, early)
        pace.end()
        return outcome


def preview(
    scan: Scan | str | PathLike | Mapping[str, Any],
    grid: VoxelGrid | None = None,
    options: Options = Options(),
    *,
    rig: Rig | str | PathLike | None = None,
    progress: Progress | bool | None = None,
    **asked: Any,
) -> Reconstruction:
    """Return a coarse reconstruction, in seconds.

    Pixels and voxels are so many times as wide that the equations have about as many segments as
    a fast computer traces and solves in a second; `Reconstruction.preview` says how many times.
    They are solved by method ``auto`` with `Options.quick`: errors of pixels, cameras and gas
    are not looked for, and there is no uncertainty.

    Parameters
    ----------
    scan, grid, rig, progress
        See `reconstruct`.
    options : Options
        Frame, held-out cameras, peak, basis, blur, absorption and carving are used.
    **asked
        Single options in place of those.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    options, scan = options.but(**asked), as_scan(scan, rig, grid)
    grid = scan.grid if grid is None else grid
    with progress_of(progress, PREVIEW) as tell:
        pace = Pace(tell)
        loaded, _, first_use = _begin(scan, grid, options, pace)
        return _previewed(loaded, grid, options, pace, first_use)


def _begin(
    scan: Scan, grid: VoxelGrid | None, options: Options, pace: Pace
) -> tuple[LoadedScan, Reference, float]:
    """Return the images, the truth, and the seconds that loading kernels took."""
    check_options(options, scan, grid)
    pace.stage("reading")
    doubts = check_cameras(scan, grid, options)
    reference = read_reference(scan, grid, options.frame)  # evaluate's; it may be unreadable
    loaded = load(scan, options.frame, grid, doubts)
    step = pace.stage("compiling")
    return loaded, reference, warm_up_stages(options.tracer, carving=options.skip, progress=step)


def _reconstruct(
    scan: Scan, grid: VoxelGrid | None, options: Options, pace: Pace, early: Early | None
) -> Reconstruction:
    """Return the reconstruction; a preview goes ahead where somebody wants to see it."""
    began, grid = time.perf_counter(), scan.grid if grid is None else grid
    loaded, reference, first_use = _begin(scan, grid, options, pace)
    if early:
        lines: list[str] = []
        quick, own, step = None, Pace(), pace.stage(PREVIEW)
        with as_warning("preview: not made", lines):
            quick = _previewed(loaded, grid, options, own, first_use, step)
        if quick is not None:
            pace.expect(_expected(own.seconds, cast("int", quick.preview)))
            early(PREVIEW, quick)
        loaded = replace(loaded, record=loaded.record + Record(warnings=tuple(lines)))
    refine = cameras_to_refine(options, loaded.scan)
    found = _run_stages(loaded, grid, options, pace, reference, refine, early)
    return assemble(found, options, first_use=first_use, seconds=time.perf_counter() - began)


def _previewed(
    loaded: LoadedScan,
    grid: VoxelGrid,
    options: Options,
    pace: Pace,
    first_use: float,
    progress: Progress | None = None,
) -> Reconstruction:
    """Return the preview of images that were read; its stages are the parts of ``progress``."""
    began, scan = time.perf_counter(), loaded.scan
    # as many segments as those that inference solves, which has so many rays in each pixel
    times = factor_of(scan.rig, grid, SEGMENTS * RAYS**2)
    images, masks = coarser_images(loaded.images, loaded.masks, times)
    small = LoadedScan(scan.scaled(times), loaded.frame, images, masks, loaded.record)
    quick = Options.quick(**{name: getattr(options, name) for name in _KEPT})
    if progress:
        pace.watch = lambda name: progress(len(pace.seconds), len(STAGES), name)
    found = _run_stages(small, coarser_grid(grid, times), quick, pace, Reference(None))
    pace.end()
    seconds = time.perf_counter() - began
    return replace(assemble(found, quick, first_use=first_use, seconds=seconds), preview=times)


def _run_stages(
    loaded: LoadedScan,
    grid: VoxelGrid,
    options: Options,
    pace: Pace,
    reference: Reference,
    refine: Sequence[str] = (),
    early: Early | None = None,
) -> Stages:
    """Return the values of all stages, from images that were read."""
    ready = prepare(loaded.scan, grid, options, [loaded], cameras=refine, stage=pace.stage)
    solved = solve(ready.built, options, watch=reference.watch, begin=pace.stage)
    solved = with_own_absorption(solved, options)
    unseen = Assessed(None, solved.built.system.unseen)

    def tell(step: str, compared: Compared, evaluated: Evaluated) -> None:
        if early:
            found = Stages(reference, loaded, ready, solved, compared, evaluated, unseen)
            early(step, assemble(found, options, first_use=0.0, seconds=pace.spent))

    masks = counted(loaded, ready.screened)
    peak = peak_of(loaded.scan, loaded.frame, [loaded.images], masks, options)
    tell(VOLUME, Compared(()), Evaluated(solved.solution, (), (), peak))
    step = pace.stage("comparing") if options.compare else None
    compared = compare(solved.built, options, watch=reference.watch, progress=step)
    pace.stage("predicted images")
    evaluated = evaluate(
        loaded, ready.screened, solved, compared, ready.apart, reference, options, peak
    )
    tell(IMAGES, compared, evaluated)
    pace.expect({TRUST: pace.seconds[SOLVE]} if pace.expected else {})
    assessed = assess(solved, options, pace.stage(TRUST), ready.screened.light_error)
    return Stages(reference, loaded, ready, solved, compared, evaluated, assessed)


def _expected(preview: Mapping[str, float], times: int) -> dict[str, float]:
    """Return the seconds that stages will take, by those of a preview ``times`` as coarse.

    There are ``times**3`` as many segments, and as many as in the preview in each ray of a pixel
    of the inferred copy. Errors are those of a known answer, solved as the volume is.
    """
    found = {name: seconds * times**3 for name, seconds in preview.items()}
    found[INFERENCE] = RAYS**2 * sum(preview.values())
    found[TRUST] = found[SOLVE]
    return found
