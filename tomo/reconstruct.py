"""From a scan to a volume: load, trace, solve, and judge the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np

from tomo._first_use import warm_up, warm_up_carving
from tomo._judging import (
    as_learned,
    data_range,
    held_out_system,
    read_truth,
    summed_up,
    views_of,
)
from tomo._laps import Laps
from tomo._memory import peak_memory
from tomo._prepare import prepare
from tomo._request import (
    cameras_to_refine,
    check_carving,
    check_device,
    check_grid,
    check_hold_out,
    check_learning,
    check_numbers,
    check_unseen,
    compared_with,
    repeats_of,
)
from tomo._run import Run
from tomo._sieve import sieve
from tomo._true_weights import true_effects, true_ratios
from tomo.condition import assess
from tomo.gains import Gains, gains_worth_correcting
from tomo.grid import VoxelGrid
from tomo.linear_system import LinearSystem, Progress, VolumeNotSeenError
from tomo.methods import AUTO, method_named
from tomo.outcome import ZERO, Outcome, View
from tomo.scan import Scan
from tomo.support import STORED


def reconstruct(
    scan: Scan,
    grid: VoxelGrid | None = None,
    *,
    method: str = AUTO,
    frame: str | None = None,
    hold_out: Sequence[str] = (),
    iterations: int | None = None,
    compare: Sequence[tuple[str, int | None]] = (),
    tracer: str = "march",
    projector: str = "auto",
    skip: bool = True,
    margin: float | str = AUTO,
    dark_level: float | str = AUTO,
    votes: int | str = AUTO,
    suspects: bool = True,
    align: bool = True,
    refine_cameras: Sequence[str] | None = None,
    refine_prior: float | None = None,
    fit_gain: bool | None = None,
    unseen: str = ZERO,
    supersample: int = 1,
    device: str = "cpu",
    encoder: str | PathLike | None = None,
    freeze_encoder: bool = False,
    checkpoint: str | PathLike | None = None,
    resume: bool = False,
    seed: int = 0,
    time_limit: float | None = None,
    uncertainty: int | str = AUTO,
    progress: Progress | None = None,
) -> Outcome:
    """Reconstruct the emission in every voxel from one frame of a scan.

    Parameters
    ----------
    scan : Scan
    grid : VoxelGrid, optional
        The scan's own when None.
    method : str
        ``auto`` chooses between the classic methods, and how smooth and how long, by predicting
        views left out; or the name of one, see `tomo.methods.method_names`.
    frame : str, optional
        The first when None.
    hold_out : sequence of str
        Cameras that are only predicted and judged; nothing else sees their images.
    iterations : int, optional
        The method's own default when None; ``auto`` then chooses.
    compare : sequence of (method, iterations)
        Further methods to run on the same rays, for the report.
    tracer : {"march", "raycast", "reference"}
        Of a stored matrix.
    projector : {"auto", "stored", "on-the-fly"}
        Whether the matrix is stored; ``auto`` stores it where it fits in memory.
    skip : bool
        Whether to leave out what cannot matter: pixels whose rays miss the grid, voxels that dark
        pixels prove empty, and the pixels that then see nothing.
    margin : float or "auto"
        Pixels around a voxel that must be dark for it to be empty; infinite: no voxel is.
    dark_level : float or "auto"
        The intensity up to which a pixel is dark.
    votes : int or "auto"
        Views that must find a voxel dark. What is ``auto`` is found from the images, see
        `tomo.support.carve`.
    suspects : bool
        Whether to leave out wild pixels, and views that the others contradict, see
        `tomo.suspects`. A camera held out is judged, never left out.
    align : bool
        Whether to look for shifts of the images, and make them where they clearly help, see
        `tomo.alignment`. A camera held out stays as it is.
    refine_cameras : sequence of str, optional
        Cameras to refine from the images, see `tomo.refine`, once images are shifted; nothing is
        shifted where all are refined. Those held out stay as they are.
    refine_prior : float, optional
        How far these may be from what the rig says, in pixels as a standard deviation; from the
        rig's calibration and the cameras' status when None.
    fit_gain : bool, optional
        Whether to fit each camera's gain and offset, see `tomo.gains`; when the views disagree
        if None.
    unseen : {"zero", "nan"}
        What `Outcome.volume` and the files hold where no usable ray crosses a voxel.
    supersample : int
        Rays along each side of a pixel.
    device : str
        For WERNet: cpu, cuda ... The classic methods, also beside it, run on the CPU.
    encoder : path or name, optional
        For WERNet: the encoder to start from, see `tomo.wernet.load_encoder`.
    freeze_encoder : bool
        Use it as it is.
    checkpoint : path, optional
        For the default WERNet: a file to keep the state of training in.
    resume : bool
        Go on from the checkpoint where there is one.
    seed : int
        Of everything random.
    time_limit : float, optional
        Seconds after which each solver stops at its current iteration, but not before its
        first; what ``auto`` takes to choose, and the repeats of ``uncertainty``, come on top.
    uncertainty : int or "auto"
        How often to repeat the solve with new noise, for the standard deviation of every voxel,
        and to find the resolution, see `tomo.condition`; 30 tell single voxels. ``auto``: as
        often as the figures for the whole volume need after method ``auto``, else 0.
    progress : callable, optional
        ``progress(done, total, where)``.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    laps = Laps()
    main = method_named(method)
    others = compared_with(compare)
    methods = [main, *(other for other, _ in others)]
    check_numbers(seed, time_limit)
    check_unseen(unseen)
    repeats = repeats_of(uncertainty, main)
    check_device(device, methods)
    check_learning(
        main, {"encoder": encoder, "freeze_encoder": freeze_encoder, "checkpoint": checkpoint}
    )
    check_hold_out(hold_out, scan)
    check_carving(
        skip=skip,
        margin=margin,
        dark_level=dark_level,
        votes=votes,
        views=len(scan.rig) - len(set(hold_out)),
    )
    refined = cameras_to_refine(refine_cameras, refine_prior, hold_out, scan)
    grid = scan.grid if grid is None else grid
    check_grid(grid, scan)
    effects = true_effects(scan)
    truth, warnings = read_truth(scan, grid)
    images, masks = scan.read(frame)
    laps.end("load")
    first_use = warm_up(tracer) + (warm_up_carving() if skip else 0.0)
    laps.skip()

    sieved = sieve(scan, images, masks, grid, hold_out, suspects=suspects)
    refined = tuple(name for name in refined if name not in sieved.left_out)
    laps.end("suspects")
    prepared = prepare(
        sieved.training.rig,
        sieved.images,
        sieved.masks,
        grid,
        align=align,
        carving={"margin": margin, "threshold": dark_level, "votes": votes} if skip else None,
        refining={"cameras": refined, "prior_pixels": refine_prior, "progress": progress}
        if refined
        else None,
        noise=sieved.noise,
    )
    laps.end("prepare")
    how: dict[str, Any] = {
        "tracer": tracer,
        "supersample": supersample,
        "form": projector,
        "progress": progress,
    }
    try:
        system = LinearSystem.from_rig(
            prepared.rig,
            grid,
            masks=prepared.masks,
            live=prepared.live,
            skip=skip,
            midpoints=any(one.needs_midpoints for one in methods),
            needs_matrix=any(one.needs_matrix for one in methods),
            **how,
        )
    except VolumeNotSeenError as error:
        held_out = f"; held out: {', '.join(hold_out)}" if hold_out else ""
        raise VolumeNotSeenError(f"{scan.source}: {error}{held_out}") from None
    if system.form != STORED:
        first_use += warm_up(tracer, system.form)
    how |= {"live": system.projector.live, "midpoints": main.needs_midpoints}
    judged_system = held_out_system(sieved.judged, grid, sieved.judged_masks, how)
    warnings += [*sieved.warnings, *prepared.warnings, *_warnings_of_views(system, judged_system)]
    laps.end("trace")

    measured = system.flatten(sieved.images)
    if not (measured > 0).any():
        warnings.append("no usable pixel that sees the volume is above 0: the volume is empty")
    gains = gains_worth_correcting(system.projector, measured, fit_gain)
    if gains:
        measured = gains.correct(system.projector, measured)
        warnings += _warning_of_gains(gains, fit_gain)
    learning = {
        "device": device,
        "encoder": encoder,
        "freeze_encoder": freeze_encoder,
        "checkpoint": checkpoint,
        "resume": resume,
    }
    run = Run(system.projector, measured, truth, learning, seed, time_limit, progress)
    found = run.solve(main, iterations)
    laps.end("solve")
    comparisons = []
    for other, count in others:
        try:
            comparisons.append(run.solve(other, count))
        except (ValueError, RuntimeError) as error:  # the reconstruction itself stands
            warnings.append(f"comparison {other.name}: {error}")
    laps.end("compare")
    again = run.again(main, found)
    condition = assess(
        system, measured, found.volume, again, repeats=repeats, seed=seed, progress=progress
    )
    warnings += [f"not to be trusted: {doubt}" for doubt in condition.warnings]
    laps.end("condition")

    seeing = as_learned(system, found, same_views=True)
    views = views_of(seeing, found.volume, sieved.images, sieved.masks, gains)
    if judged_system is not None:
        judging = as_learned(judged_system, found, same_views=False)
        views += _judged(
            views_of(judging, found.volume, sieved.judged_images, sieved.judged_masks),
            hold_out,
            sieved.left_out,
        )
    learned = None
    if found.weights is not None:
        ratios = true_ratios(system, effects, truth, gains) if supersample == 1 else None
        learned = summed_up(system, seeing, found, ratios)
    no_ray = system.unseen
    n_unseen = int(np.count_nonzero(no_ray))
    if n_unseen:
        warnings.append(
            f"{n_unseen / grid.size:.1%} of the voxels are seen by no camera: their {unseen} says "
            "nothing"
        )
    settings = {
        "asked": {"method": method, "iterations": iterations},
        "frame": scan.frame(frame).name,
        "hold_out": list(hold_out),
        "tracer": tracer if system.form == STORED else "column changes",
        "projector": {"form": system.form, "reason": system.reason},
        "skip": skip,
        "margin": margin,
        "dark_level": dark_level,
        "votes": votes,
        "suspects": suspects,
        "align": align,
        "refine_cameras": list(refined) or None,
        "refine_prior": refine_prior,
        "fit_gain": fit_gain,
        "unseen": unseen,
        "supersample": supersample,
        "scale": scan.shrink,
        "device": device,
        "encoder": None if encoder is None else str(encoder),
        "freeze_encoder": freeze_encoder,
        "seed": seed,
        "time_limit": time_limit,
        "uncertainty": uncertainty,
        "grid": {"shape": grid.shape, "spacing": grid.spacing, "center": grid.center},
    }
    return Outcome(
        reconstruction=replace(found, peak_memory=peak_memory()),
        rig=scan.rig,
        views=tuple(sorted(views, key=lambda view: scan.rig.names.index(view.name))),
        data_range=data_range(scan, frame, [v.measured for v in views if not v.left_out]),
        truth=truth,
        comparisons=tuple(comparisons),
        counts={
            "rays": system.projector.shape[0] * supersample**2,
            "segments": system.projector.n_crossings,
            "voxels": grid.size,
            "active_voxels": system.projector.live.size - n_unseen,
        },
        skipping=prepared.report(system.projector.shape[0]),
        suspects=sieved.suspects.report() if sieved.suspects else None,
        alignment=prepared.alignment.report(prepared.rig.names) if prepared.alignment else None,
        refinement=prepared.refinement.report() if prepared.refinement else None,
        refined_rig=prepared.recorded_rig(scan) if refined else None,
        gains=gains.report(prepared.rig.names) if gains else None,
        seconds={**laps.seconds, "choose": found.seconds["choose"], "total": laps.total},
        first_use_seconds=first_use,
        unseen=no_ray,
        warnings=tuple(warnings),
        settings=settings,
        cosine_distances=tuple(run.cosine_distances),
        learned=learned,
        condition=condition,
    )


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


def _judged(views: Sequence[View], hold_out: Sequence[str], left_out: Sequence[str]) -> list[View]:
    return [
        replace(view, held_out=view.name in hold_out, left_out=view.name in left_out)
        for view in views
    ]
