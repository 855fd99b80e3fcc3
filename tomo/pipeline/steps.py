"""The steps of a reconstruction: load, set aside, prepare, trace, solve, and judge the result."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from tomo._compute.memory import peak_memory
from tomo.grid import VoxelGrid
from tomo.operators import LINEAR, STORED, LinearSystem
from tomo.operators.system import Progress, VolumeNotSeenError
from tomo.pipeline.as_warning import as_warning
from tomo.pipeline.basis import of_basis
from tomo.pipeline.check_options import cameras_to_refine, check_options, methods_of, repeats_of
from tomo.pipeline.checks import comparison
from tomo.pipeline.evaluate import (
    as_learned,
    data_range,
    held_out_system,
    read_truth,
    summed_up,
    views_of,
)
from tomo.pipeline.first_use import warm_up, warm_up_alignment, warm_up_carving
from tomo.pipeline.methods import Method
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.reconstruction import Reconstruction, View
from tomo.pipeline.refit import solved_once_more
from tomo.pipeline.register import Prepared, prepare
from tomo.pipeline.run import Run
from tomo.pipeline.screen import ScreenedScan, screen_views
from tomo.pipeline.stage_timings import Laps
from tomo.pipeline.weights import weights_of
from tomo.scan import Scan
from tomo.selfcal.gains import Gains, gains_worth_correcting
from tomo.simulation.true_weights import true_effects, true_ratios
from tomo.solvers import Solution
from tomo.uncertainty import assess


def reconstruct_as_asked(
    scan: Scan, grid: VoxelGrid | None, options: Options, progress: Progress | None
) -> Reconstruction:
    """Return what `tomo.pipeline.reconstruct` does.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    laps = Laps()
    check_options(options, scan, grid)
    methods = methods_of(options)
    effects = true_effects(scan)
    truth, warnings = read_truth(scan, grid)
    images, masks = scan.read(options.frame)
    laps.end("load")
    first_use = warm_up(options.tracer)
    first_use += warm_up_carving() if options.skip else 0.0
    first_use += warm_up_alignment() if options.align else 0.0
    laps.skip()

    screened = screen_views(scan, images, masks, grid, options.hold_out, suspects=options.screen)
    brightest = data_range(scan, options.frame, screened.not_left_out)
    laps.end("suspects")
    refined = tuple(
        name for name in cameras_to_refine(options, scan) if name not in screened.left_out
    )
    refining = {
        "cameras": refined,
        "prior_pixels": options.refine_prior,
        "progress": progress,
    }
    prepared = prepare(
        screened.training.rig,
        screened.images,
        screened.masks,
        grid,
        align=options.align,
        carving=_carving(options),
        refining=refining if refined else None,
        noise=screened.noise if options.skip else None,
        unmodelled_light=screened.unmodelled_light,
    )
    laps.end("prepare")
    system, judged_system = _traced(prepared, screened, grid, options, methods, progress)
    if options.blur:
        system = system.with_lens_blur(options.blur)
        judged_system = judged_system and judged_system.with_lens_blur(options.blur)
    if system.form != STORED:
        first_use += warm_up(options.tracer, system.form)
    warnings += screened.warnings
    later = _warnings_of_views(system, judged_system)
    laps.end("trace")

    measured = system.flatten(screened.images)
    if not (measured > 0).any():
        later.append("no usable pixel that sees the volume is above 0: the volume is empty")
    gains = gains_worth_correcting(system.projector, measured, options.fit_gain)
    if gains:
        measured = gains.correct(system.projector, measured)
        later += _warning_of_gains(gains, options.fit_gain)
    system, basis = of_basis(system, measured, options, methods[0])
    weights, weighing = weights_of(system, screened, gains, options)
    run = Run(
        system.projector,
        measured,
        truth,
        _learning(options),
        options.seed,
        options.time_limit,
        progress,
        weights,
    )
    found = run.solve(methods[0], options.iterations)
    system, basis, run, found = solved_once_more(system, basis, run, found, options)
    if basis.name == LINEAR:
        judged_system = judged_system and judged_system.with_linear_basis(options.supersample)
    if options.save_encoder is not None:
        _save_encoder(found, options.save_encoder, later)
    laps.end("solve")
    comparisons = []
    for other, written in zip(methods[1:], options.compare, strict=True):
        with as_warning(f"comparison {other.name}", later):
            comparisons.append(run.solve(other, comparison(written)[1]))
    laps.end("compare")
    prepared = _cameras_judged(prepared, later)  # takes its time
    warnings += [*prepared.warnings, *later]
    condition = None
    with as_warning("condition: how far to trust the volume was not found", warnings):
        condition = assess(
            system.on_voxel_means,
            measured,
            found.volume,
            run.again(methods[0], found),
            repeats=repeats_of(options),
            seed=options.seed,
            progress=progress,
        )
        warnings += [f"not to be trusted: {doubt}" for doubt in condition.warnings]
    laps.end("condition")

    views, learned = [], None
    with as_warning("re-projected images: not found", warnings):
        seeing = as_learned(system, found, same_views=True)
        views += views_of(
            seeing.on_voxel_means, found.volume, screened.images, screened.masks, gains
        )
        views += _views_judged(judged_system, found, screened, options)
        if found.weights is not None:
            comparable = options.supersample == 1
            ratios = true_ratios(system, effects, truth, gains) if comparable else None
            learned = summed_up(system, seeing, found, ratios)
    no_ray = system.unseen
    n_unseen = int(np.count_nonzero(no_ray))
    if n_unseen:
        share = n_unseen / grid.size
        how_many = f"{share:.1%}" if share >= 0.0005 else "less than 0.1%"
        warnings.append(
            f"{how_many} of the voxels are seen by no camera: their {options.unseen} says nothing"
        )
    names = prepared.rig.names
    return Reconstruction(
        reconstruction=replace(found, peak_memory=peak_memory()),
        rig=scan.rig,
        views=tuple(sorted(views, key=lambda view: scan.rig.names.index(view.name))),
        data_range=brightest,
        truth=truth,
        comparisons=tuple(comparisons),
        counts={
            "rays": system.projector.shape[0] * options.supersample**2,
            "segments": system.projector.n_segments,
            "voxels": grid.size,
            "active_voxels": system.projector.active.size - n_unseen,
        },
        carving=prepared.report(system.projector.shape[0]),
        screening=screened.suspects.report() if screened.suspects else None,
        alignment=prepared.alignment.report(names) if prepared.alignment else None,
        refinement=prepared.refinement.report() if prepared.refinement else None,
        refined_rig=prepared.recorded_rig(scan) if refined else None,
        gains=gains.report(names) if gains else None,
        seconds={**laps.seconds, "choose": found.seconds["choose"], "total": laps.total},
        first_use_seconds=first_use,
        unseen=no_ray,
        warnings=tuple(warnings),
        options=options,
        scan={
            "frame": scan.frame(options.frame).name,
            "scale": scan.shrink,
            "grid": {"shape": grid.shape, "spacing": grid.spacing, "center": grid.center},
        },
        projector={
            "form": system.form,
            "reason": system.reason,
            "tracer": options.tracer if system.form == STORED else "column changes",
        },
        basis=basis.report(),
        pixel_weights=weighing,
        cosine_distances=tuple(run.cosine_distances),
        learned=learned,
        uncertainty=condition,
    )


def _save_encoder(found: Solution, path: str, warnings: list[str]) -> None:
    """Write the encoder that a solve trained, or warn that it trained none."""
    from tomo.wernet import save_encoder

    if found.encoder is None:
        warnings.append(f"save_encoder: {path} was not written: no encoder was trained")
    else:
        save_encoder(found.encoder, path)


def _cameras_judged(prepared: Prepared, warnings: list[str]) -> Prepared:
    """Return it with its cameras' displacement found, or without any where that failed."""
    if prepared.alignment is None:
        return prepared
    with as_warning("cameras: whether images agree with them was not found", warnings):
        _ = prepared.alignment.displacement
        return prepared
    return replace(prepared, alignment=replace(prepared.alignment, evaluated=None))


def _traced(
    prepared: Prepared,
    screened: ScreenedScan,
    grid: VoxelGrid,
    options: Options,
    methods: list[Method],
    progress: Progress | None,
) -> tuple[LinearSystem, LinearSystem | None]:
    """Return the system of the views that take part, and that of those only judged, if any are."""
    how: dict[str, Any] = {
        "tracer": options.tracer,
        "supersample": options.supersample,
        "form": options.projector,
        "progress": progress,
    }
    try:
        system = LinearSystem.from_rig(
            prepared.rig,
            grid,
            masks=prepared.masks,
            active=prepared.active,
            skip=options.skip,
            midpoints=any(one.needs_midpoints for one in methods),
            needs_matrix=any(one.needs_matrix for one in methods),
            **how,
        )
    except VolumeNotSeenError as error:
        hold_out = options.hold_out
        held_out = f"; held out: {', '.join(hold_out)}" if hold_out else ""
        raise VolumeNotSeenError(f"{screened.training.source}: {error}{held_out}") from None
    how |= {"active": system.projector.active, "midpoints": methods[0].needs_midpoints}
    return system, held_out_system(screened.judged, grid, screened.judged_masks, how)


def _carving(options: Options) -> dict[str, Any] | None:
    """Return the settings of `tomo.hull.carve`; None where nothing is carved."""
    if not options.skip:
        return None
    return {"margin": math.inf if options.carving == OFF else options.carving}


def _learning(options: Options) -> dict[str, Any]:
    """Return the arguments that only methods that learn take."""
    names = ("device", "encoder", "freeze_encoder", "checkpoint", "resume")
    return {name: getattr(options, name) for name in names}


def _views_judged(
    system: LinearSystem | None, found: Solution, screened: ScreenedScan, options: Options
) -> list[View]:
    """Return the images that took no part beside what the volume would have shown."""
    if system is None:
        return []
    judging = as_learned(system, found, same_views=False)
    return [
        replace(
            view,
            held_out=view.name in options.hold_out,
            left_out=view.name in screened.left_out,
        )
        for view in views_of(
            judging.on_voxel_means, found.volume, screened.judged_images, screened.judged_masks
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
