"""The frames of a block: their volumes, solved together, filtered in time; and their figures."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tomo.pipeline.build import WeightedSystem
from tomo.pipeline.evaluate import read_reference, views_of
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.screen import FrameImages
from tomo.pipeline.solve import Solved, solve_by, voxel_means_of, with_own_absorption
from tomo.pipeline.trace import through_gas
from tomo.pipeline.view import View, quality
from tomo.radiometry.units import unit_of_total
from tomo.selection import solve_several_smoothly
from tomo.selection.choose import Choice
from tomo.selection.smooth_solve import smooth_start
from tomo.series.plan import BlockSystem, Plan, weighted
from tomo.series.temporal import TemporalFilter, growth
from tomo.solvers import Iteration, Solution


@dataclass(frozen=True, eq=False)
class FrameResult:
    """The volume of one frame and what is said of it; nothing of one that could not be read."""

    volume: NDArray[np.float32] | None  # (nx, ny, nz); None once it is written
    figures: Mapping[str, float]
    by_camera: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    skipped: bool = False


SKIPPED = FrameResult(None, {}, skipped=True)
"""The result of a frame that could not be read."""


def solve_frame(plan: Plan, system: BlockSystem, frame: FrameImages) -> FrameResult:
    """Solve one frame by the method that options name, and compare it with its images."""
    began, options, built = time.perf_counter(), plan.options, weighted(plan, system, frame)
    found = solve_by(method_named(options.method), options.iterations, built, options)
    return compared(plan, system, frame, Solved(found, built), began)


def solve_together(
    plan: Plan,
    system: BlockSystem,
    frames: Sequence[FrameImages],
    choice: Choice,
) -> Iterator[FrameResult]:
    """Solve some frames of a block together, see `mlem_of_several`, and compare them."""
    if not frames:
        return
    began = time.perf_counter()
    built = [weighted(plan, system, frame) for frame in frames]
    results = solved_together(plan, built, choice)
    shared = (time.perf_counter() - began) / len(frames)
    for frame, (found, _) in zip(frames, results, strict=True):
        yield compared(plan, system, frame, found, time.perf_counter() - shared)


def solved_together(
    plan: Plan, built: Sequence[WeightedSystem], choice: Choice
) -> list[tuple[Solved, NDArray[np.float32]]]:
    """Return the solutions of several frames' pixels, see `solve_together`, and the unknowns."""
    began, options, projector = time.perf_counter(), plan.options, built[0].system.projector
    measured = np.stack([one.measured for one in built], axis=1)  # (pixels, frames)
    weights = None
    if any(one.weights is not None for one in built):  # a dim frame has none: its pixels are alike
        alike = np.ones(len(measured), np.float32)
        each = [alike if one.weights is None else one.weights for one in built]
        weights = np.stack(each, axis=1)
    iterations = options.iterations or choice.iterations
    found = solve_several_smoothly(
        projector,
        measured,
        width=choice.width,
        strength=choice.strength,
        iterations=iterations,
        start=smooth_start(projector, measured),
        weights=weights,
    )  # (unknowns, frames)
    shared, results = (time.perf_counter() - began) / len(built), []
    for number, one in enumerate(built):
        unknowns = np.ascontiguousarray(found[:, number])
        solution = Solution(
            voxel_means_of(projector, unknowns),
            plan.grid,
            (Iteration(iterations, math.nan, shared),),
            {"method": AUTO, "strength": choice.strength, "smooth_width": choice.width},
        )
        results.append((Solved(solution, one), unknowns))
    return results


def compared(
    plan: Plan,
    system: BlockSystem,
    frame: FrameImages,
    solved: Solved,
    began: float,
) -> FrameResult:
    """Return the volume with its figures, seen through gas of its own emission where that is."""
    solved = with_own_absorption(solved, plan.options)
    figures, by_camera = _figures(plan, system, frame, solved)
    figures["seconds"] = time.perf_counter() - began
    return FrameResult(solved.solution.volume, figures, by_camera, frame.warnings)


def _figures(
    plan: Plan, system: BlockSystem, frame: FrameImages, solved: Solved
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return the figures of a volume, such as its total, and those of its images by camera."""
    built, volume = solved.built, solved.solution.volume
    means, (sight, sight_apart) = built.system.on_voxel_means, system.in_sight
    views = views_of(means, volume, frame.images, frame.masks, in_sight=sight)
    views = [
        replace(view, noise=one) for view, one in zip(views, plan.registered.noise, strict=True)
    ]
    apart: list[View] = []
    if system.apart is not None:
        other = system.apart
        if built.absorption.emission:
            other = through_gas(other, built.absorption, volume, plan.options)
        apart = views_of(
            other.on_voxel_means, volume, frame.apart_images, frame.apart_masks,
            in_sight=sight_apart,
        )  # fmt: skip
    held_out = [view for view in apart if view.name in plan.options.hold_out]
    fitted = [view.fitted[2] if view.fitted else view for view in held_out]
    light, per_total = plan.scan.radiometry, 1.0
    if light is not None:
        _, per_total = unit_of_total(light.value_unit, plan.scan.rig.length_unit)
    alike = {view.name: view.similarity(plan.peak.value) for view in held_out}
    figures = {
        "relative_residual": _relative_residual(views),
        "total_emission": volume.total() * per_total,
        **_against_the_truth(plan, frame, volume),
    }
    return figures, {
        "view_residual": {view.name: view.relative_residual for view in [*views, *apart]},
        "view_gain": {view.name: view.gain for view in [*views, *apart]},
        "view_light": {view.name: view.light for view in [*views, *apart]},
        "view_beyond_noise": {view.name: view.beyond_noise for view in [*views, *fitted]},
        "psnr": {name: each["psnr"] for name, each in alike.items()},
        "ssim": {name: each.get("ssim", math.nan) for name, each in alike.items()},
    }


def _against_the_truth(
    plan: Plan, frame: FrameImages, volume: NDArray[np.float32]
) -> dict[str, float]:
    """Return the errors of a volume, NaN where no truth is on its grid."""
    truth = read_reference(plan.scan, plan.grid, frame.name).truth
    figures = quality(volume, truth)
    return {name: figures.get(name, math.nan) for name in ("nrmse", "cosine_distance")}


def _relative_residual(views: list[View]) -> float:
    """Return the residual of all usable pixels of some views, relative to these."""
    squared = light = 0.0
    for view in views:
        usable = view.usable
        measured = view.measured[usable].astype(np.float64)
        squared += float(np.sum((measured - view.reprojected[usable]) ** 2))
        light += float(np.sum(measured**2))
    return math.sqrt(squared / light) if light > 0 else math.nan


def solve_filtered(
    plan: Plan,
    system: BlockSystem,
    own: Sequence[int],
    frames: Mapping[int, FrameImages],
    choice: Choice,
    temporal: TemporalFilter,
) -> Iterator[tuple[int, FrameResult]]:
    """Yield the places of a block's frames and their results, filtered in time."""
    began = time.perf_counter()
    built = {place: weighted(plan, system, frame) for place, frame in frames.items()}
    found = dict(zip(frames, solved_together(plan, list(built.values()), choice), strict=True))
    solutions = {place: unknowns for place, (_, unknowns) in found.items()}
    projector = system.built.system.projector
    spent = (time.perf_counter() - began) / len(own)
    for place in own:
        now = time.perf_counter() - spent
        result, alone = found[place]
        unknowns = temporal.apply(projector.active, solutions, place)
        if growth(built[place], alone, unknowns) <= temporal.most:
            volume = voxel_means_of(projector, unknowns)
            result = replace(result, solution=replace(result.solution, volume=volume))
        yield place, compared(plan, system, frames[place], result, now)
