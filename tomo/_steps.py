"""The steps of a reconstruction: load, set aside, prepare, trace, solve, and judge the result."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tomo._as_warning import as_warning
from tomo._basis import of_basis
from tomo._first_use import warm_up, warm_up_alignment, warm_up_carving
from tomo._judging import (
    as_learned,
    data_range,
    held_out_system,
    read_truth,
    summed_up,
    views_of,
)
from tomo._laps import Laps
from tomo._last_solve import solved_once_more
from tomo._memory import peak_memory
from tomo._prepare import Prepared, prepare
from tomo._request import Request
from tomo._run import Run
from tomo._sieve import Sieved, sieve
from tomo._true_weights import true_effects, true_ratios
from tomo._weights import weights_of
from tomo.condition import assess
from tomo.defocus import blur_of_images
from tomo.gains import Gains, gains_worth_correcting
from tomo.grid import VoxelGrid
from tomo.linear_system import LinearSystem, Progress, VolumeNotSeenError
from tomo.outcome import Outcome, View
from tomo.reconstruction import Reconstruction
from tomo.scan import Scan
from tomo.solve.basis import SPLINES
from tomo.support import STORED


def reconstruct_as_asked(
    scan: Scan, grid: VoxelGrid | None, request: Request, progress: Progress | None
) -> Outcome:
    """Return what `tomo.reconstruct.reconstruct` does.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    laps = Laps()
    request.check(scan, grid)
    effects = true_effects(scan)
    truth, warnings = read_truth(scan, grid)
    images, masks = scan.read(request.frame)
    laps.end("load")
    first_use = warm_up(request.tracer)
    first_use += warm_up_carving() if request.skip else 0.0
    first_use += warm_up_alignment() if request.align else 0.0
    laps.skip()

    sieved = sieve(scan, images, masks, grid, request.hold_out, suspects=request.suspects)
    brightest = data_range(scan, request.frame, sieved.not_left_out)
    laps.end("suspects")
    refined = tuple(name for name in request.refined(scan) if name not in sieved.left_out)
    refining = {
        "cameras": refined,
        "prior_pixels": request.refine_prior,
        "progress": progress,
    }
    prepared = prepare(
        sieved.training.rig,
        sieved.images,
        sieved.masks,
        grid,
        align=request.align,
        carving=request.carving,
        refining=refining if refined else None,
        noise=sieved.noise if request.skip else None,
        strange_light=sieved.strange_light,
    )
    laps.end("prepare")
    system, judged_system = _traced(prepared, sieved, grid, request, progress)
    blur = _blur(system, sieved, request)
    if blur:
        system = system.out_of_focus(blur)
        judged_system = judged_system and judged_system.out_of_focus(blur)
    if system.form != STORED:
        first_use += warm_up(request.tracer, system.form)
    warnings += sieved.warnings
    later = _warnings_of_views(system, judged_system)
    if blur and request.diameter is None:
        later.append(
            f"images are out of focus: they show discs of {blur:.3g} {scan.rig.length_unit}, "
            "through which they were reconstructed"
        )
    laps.end("trace")

    measured = system.flatten(sieved.images)
    if not (measured > 0).any():
        later.append("no usable pixel that sees the volume is above 0: the volume is empty")
    gains = gains_worth_correcting(system.projector, measured, request.fit_gain)
    if gains:
        measured = gains.correct(system.projector, measured)
        later += _warning_of_gains(gains, request.fit_gain)
    system, basis = of_basis(system, measured, request, request.main)
    weights, weighing = weights_of(system, sieved, gains, request)
    run = Run(
        system.projector,
        measured,
        truth,
        request.learning,
        request.seed,
        request.time_limit,
        progress,
        weights,
    )
    found = run.solve(request.main, request.iterations)
    system, basis, run, found = solved_once_more(system, basis, run, found, request)
    if basis.name == SPLINES:
        judged_system = judged_system and judged_system.of_splines(request.supersample)
    laps.end("solve")
    comparisons = []
    for other, count in request.others:
        with as_warning(f"comparison {other.name}", later):
            comparisons.append(run.solve(other, count))
    laps.end("compare")
    prepared = _cameras_judged(prepared, later)  # takes its time
    warnings += [*prepared.warnings, *later]
    condition = None
    with as_warning("condition: how far to trust the volume was not found", warnings):
        condition = assess(
            system.of_averages,
            measured,
            found.volume,
            run.again(request.main, found),
            repeats=request.repeats,
            seed=request.seed,
            progress=progress,
        )
        warnings += [f"not to be trusted: {doubt}" for doubt in condition.warnings]
    laps.end("condition")

    views, learned = [], None
    with as_warning("re-projected images: not found", warnings):
        seeing = as_learned(system, found, same_views=True)
        views += views_of(seeing.of_averages, found.volume, sieved.images, sieved.masks, gains)
        views += _views_judged(judged_system, found, sieved, request)
        if found.weights is not None:
            comparable = request.supersample == 1
            ratios = true_ratios(system, effects, truth, gains) if comparable else None
            learned = summed_up(system, seeing, found, ratios)
    no_ray = system.unseen
    n_unseen = int(np.count_nonzero(no_ray))
    if n_unseen:
        share = n_unseen / grid.size
        how_many = f"{share:.1%}" if share >= 0.0005 else "less than 0.1%"
        warnings.append(
            f"{how_many} of the voxels are seen by no camera: their {request.unseen} says nothing"
        )
    names = prepared.rig.names
    return Outcome(
        reconstruction=replace(found, peak_memory=peak_memory()),
        rig=scan.rig,
        views=tuple(sorted(views, key=lambda view: scan.rig.names.index(view.name))),
        data_range=brightest,
        truth=truth,
        comparisons=tuple(comparisons),
        counts={
            "rays": system.projector.shape[0] * request.supersample**2,
            "segments": system.projector.n_crossings,
            "voxels": grid.size,
            "active_voxels": system.projector.live.size - n_unseen,
        },
        skipping=prepared.report(system.projector.shape[0]),
        suspects=sieved.suspects.report() if sieved.suspects else None,
        alignment=prepared.alignment.report(names) if prepared.alignment else None,
        refinement=prepared.refinement.report() if prepared.refinement else None,
        refined_rig=prepared.recorded_rig(scan) if refined else None,
        gains=gains.report(names) if gains else None,
        seconds={**laps.seconds, "choose": found.seconds["choose"], "total": laps.total},
        first_use_seconds=first_use,
        unseen=no_ray,
        warnings=tuple(warnings),
        settings={
            **request.settings(scan, grid),
            "tracer": request.tracer if system.form == STORED else "column changes",
            "projector": {"form": system.form, "reason": system.reason},
            "refine_cameras": list(refined) or None,
            "blur": blur,
            "basis": basis.report(),
            "weights": weighing,
        },
        cosine_distances=tuple(run.cosine_distances),
        learned=learned,
        condition=condition,
    )


def _cameras_judged(prepared: Prepared, warnings: list[str]) -> Prepared:
    """Return it with its cameras' displacement found, or without any where that failed."""
    if prepared.alignment is None:
        return prepared
    with as_warning("cameras: whether images agree with them was not found", warnings):
        _ = prepared.alignment.displacement
        return prepared
    return replace(prepared, alignment=replace(prepared.alignment, judged=None))


def _traced(
    prepared: Prepared,
    sieved: Sieved,
    grid: VoxelGrid,
    request: Request,
    progress: Progress | None,
) -> tuple[LinearSystem, LinearSystem | None]:
    """Return the system of the views that take part, and that of those only judged, if any are."""
    how: dict[str, Any] = {
        "tracer": request.tracer,
        "supersample": request.supersample,
        "form": request.projector,
        "progress": progress,
    }
    try:
        system = LinearSystem.from_rig(
            prepared.rig,
            grid,
            masks=prepared.masks,
            live=prepared.live,
            skip=request.skip,
            midpoints=request.needs_midpoints,
            needs_matrix=request.needs_matrix,
            **how,
        )
    except VolumeNotSeenError as error:
        hold_out = request.hold_out
        held_out = f"; held out: {', '.join(hold_out)}" if hold_out else ""
        raise VolumeNotSeenError(f"{sieved.training.source}: {error}{held_out}") from None
    how |= {"live": system.projector.live, "midpoints": request.main.needs_midpoints}
    return system, held_out_system(sieved.judged, grid, sieved.judged_masks, how)


def _blur(system: LinearSystem, sieved: Sieved, request: Request) -> float:
    """Return the diameter of the discs that the images that take part are blurred by."""
    if request.diameter is not None:
        return request.diameter
    images = [
        np.where(mask, image, np.float32(0))
        for image, mask in zip(sieved.images, sieved.masks, strict=True)
    ]
    return blur_of_images(system.rig, images, system.projector.grid) or 0.0


def _views_judged(
    system: LinearSystem | None, found: Reconstruction, sieved: Sieved, request: Request
) -> list[View]:
    """Return the images that took no part beside what the volume would have shown."""
    if system is None:
        return []
    judging = as_learned(system, found, same_views=False)
    return [
        replace(
            view,
            held_out=view.name in request.hold_out,
            left_out=view.name in sieved.left_out,
        )
        for view in views_of(
            judging.of_averages, found.volume, sieved.judged_images, sieved.judged_masks
        )
    ]


def _warnings_of_views(*systems: LinearSystem | None) -> list[str]:
    return [
        f"camera {name}: none of its usable pixels sees the volume"
        for system in systems
        if system is not None
        for name in system.blind
    ]


def _warning_of_gains(gains: Gains, asked: bool | None) -> list[str]:
    if asked:
        return []
    return [
        f"the cameras' gains differ by {gains.disagreement:.1%}, or their backgrounds: both were "
        "fitted and corrected"
    ]
