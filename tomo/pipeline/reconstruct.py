"""One reconstruction: its stages in their order, each a function from values to a value."""

from __future__ import annotations

import time
from collections.abc import Mapping
from os import PathLike
from typing import Any

from rigs import Rig
from rigs.progress import Progress, progress_of, staged
from tomo.grid import VoxelGrid
from tomo.pipeline.assemble import Stages, assemble
from tomo.pipeline.assess import assess
from tomo.pipeline.check_cameras import check_cameras
from tomo.pipeline.check_options import (
    cameras_to_refine,
    check_options,
)
from tomo.pipeline.evaluate import evaluate, read_reference
from tomo.pipeline.first_use import warm_up_stages
from tomo.pipeline.load import load
from tomo.pipeline.options import Options
from tomo.pipeline.prepare import prepare
from tomo.pipeline.reconstruction import Reconstruction
from tomo.pipeline.self_absorption import with_own_absorption
from tomo.pipeline.solve import compare, solve
from tomo.scan import Scan
from tomo.scan.given import as_scan


def reconstruct(
    scan: Scan | str | PathLike | Mapping[str, Any],
    grid: VoxelGrid | None = None,
    options: Options = Options(),
    *,
    rig: Rig | str | PathLike | None = None,
    progress: Progress | bool | None = None,
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
    **asked
        Single options, such as ``method="mlem"``, in place of those of ``options``.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    options, scan = options.but(**asked), as_scan(scan, rig, grid)
    with progress_of(progress, "reconstruct") as tell:
        return _run_stages(scan, grid, options, tell)


def _run_stages(
    scan: Scan, grid: VoxelGrid | None, options: Options, progress: Progress | None
) -> Reconstruction:
    began, grid = time.perf_counter(), scan.grid if grid is None else grid
    check_options(options, scan, grid)
    stage = staged(progress)
    doubts = check_cameras(scan, grid, options)
    reference = read_reference(scan, grid, options.frame)  # evaluate's; it may be unreadable
    loaded = load(scan, options.frame, grid, doubts)
    stage("compiling")
    first_use = warm_up_stages(options.tracer, carving=options.skip)
    refine = cameras_to_refine(options, scan)
    ready = prepare(scan, grid, options, [loaded], cameras=refine, stage=stage)
    step = stage("smoothness and solve")
    solved = solve(ready.built, options, watch=reference.watch, progress=step)
    solved = with_own_absorption(solved, options)
    step = stage("comparing") if options.compare else None
    compared = compare(solved.built, options, watch=reference.watch, progress=step)
    stage("predicted images")
    evaluated = evaluate(loaded, ready.screened, solved, compared, ready.apart, reference, options)
    step = stage("how far to trust it")
    assessed = assess(solved, options, step, ready.screened.light_error)
    stages = Stages(reference, loaded, ready, solved, compared, evaluated, assessed)
    return assemble(stages, options, first_use=first_use, seconds=time.perf_counter() - began)
