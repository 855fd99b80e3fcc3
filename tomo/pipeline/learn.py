"""Stage 8, learn: weights in place of segment lengths, where these do not explain the images.

The default goes on to WERNet only where images differ from their re-projections by more than
noise, and takes what it learns only where left-out pixels are predicted better, by more than
chance.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._compute.grouping import golden_ratio_sequence
from tomo.operators import LINEAR, STORED, LinearSystem
from tomo.operators.system import Progress
from tomo.pipeline.basis import BLOCK
from tomo.pipeline.evidence import SEGMENTS, variance_of
from tomo.pipeline.explain import FEWEST_VIEWS
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.options import Options
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.solve import Solved, Watch, choice_of, solve_by
from tomo.pipeline.stage import Record, as_warning, timed
from tomo.pipeline.trace import through_gas
from tomo.screening.causes import ABSORBING
from tomo.screening.hypotheses import SURE
from tomo.screening.left_out_blocks import blocks_of
from tomo.selection.folds import LEFT_OUT

_WORDS = {"upstream emission": "self-absorption", "off the axis, squared": "vignetting"}


@dataclass(frozen=True, eq=False)
class Learned:
    """The solution, with learned weights where they predict left-out pixels better.

    Attributes
    ----------
    solved : Solved
    report : mapping, optional
        ``report.json``'s ``learning``; None where learning was not looked at.
    record : Record
    """

    solved: Solved
    report: dict[str, Any] | None = None
    record: Record = Record()


def learn(
    solved: Solved,
    screened: ScreenedScan,
    options: Options,
    *,
    watch: Watch | None = None,
    progress: Progress | None = None,
) -> Learned:
    """Go on to learned weights where segment lengths leave the images unexplained."""
    if not options.learn or method_named(options.method).name != AUTO:
        return Learned(solved)
    report = {"tried": False, "taken": False, "found": [], "reason": ""}
    with timed() as stage, as_warning("learned weights: not tried", stage.warnings):
        began = time.perf_counter()
        report["reason"] = _not_needed(solved, screened, options)
        if not report["reason"]:
            solved, found = _learned(solved, options, watch, progress)
            report |= found
            if report["taken"]:
                seconds = solved.solution.seconds
                total = seconds["total"] + time.perf_counter() - began
                solution = replace(solved.solution, seconds={**seconds, "total": total})
                solved = replace(solved, solution=solution)
                stage.warnings.append(_of_weights(report))
    return Learned(solved, report, stage.record)


def _not_needed(solved: Solved, screened: ScreenedScan, options: Options) -> str:
    """Return why nothing is to be learned; empty where the images ask for it."""
    system, measured = solved.built.system, solved.built.measured
    if system.form != STORED or options.blur or options.aperture_rays > 1:
        return "weights are learned for stored rays in focus"
    if len(system.projector.views_with_pixels) < FEWEST_VIEWS:
        return "too few views: whatever the weights, some volume reproduces them"
    if not measured.any():
        return "the images are dark"
    residual, noise = _left_out_residual(solved), _relative_noise(solved, screened)
    chance = math.sqrt(2 / max(LEFT_OUT * len(measured), 1))
    if not residual**2 > noise**2 * (1 + SURE * chance):
        return (
            f"noise explains the left-out pixels (relative residual {residual:.4f}, noise "
            f"{noise:.4f})"
        )
    return ""


def _left_out_residual(solved: Solved) -> float:
    """Return the relative residual of left-out pixels by the default's own choice."""
    tried = solved.solution.settings.get("tried", ())
    return min((one.held_out_residual for one in tried), default=math.nan)


def _relative_noise(solved: Solved, screened: ScreenedScan) -> float:
    """Return the noise of the pixels over their light, weighted as the residual is."""
    built, measured = solved.built, solved.built.measured.astype(np.float64)
    variance = variance_of(built.system, measured, screened.noise)
    weights = 1.0 if built.weights is None else built.weights
    light = float((weights * np.square(measured)).sum())
    return math.sqrt(float((weights * variance).sum()) / light)


def _learned(
    solved: Solved, options: Options, watch: Watch | None, progress: Progress | None
) -> tuple[Solved, dict[str, Any]]:
    """Return the solution by learned weights if these predict left-out pixels better."""
    from tomo.wernet.default import UPSTREAM, VIGNETTING, LeftOut, learn_shared

    built, choice = solved.built, choice_of(solved)
    kept = _pixels_that_fit(built.system)
    weights = None if built.weights is None else built.weights[kept]
    sample = _with_midpoints(solved, options, kept)
    pixels = LeftOut.of(sample.projector, built.measured[kept], sample.blocks(BLOCK), weights)
    volume = sample.projector.active.compress(solved.solution.volume)
    found = learn_shared(pixels, choice, volume)
    lengths, learned = found.residuals
    if UPSTREAM in found.terms and learned**2 >= ABSORBING * lengths**2:
        # details finer than voxels look like it, and the explanations did not find it either
        found = learn_shared(pixels, choice, volume, (VIGNETTING,))
    report = {
        "tried": not math.isnan(found.residuals[1]),
        "found": list(found.terms),
        "left_out_residual": dict(
            zip(("segment_lengths", "learned"), found.residuals, strict=True)
        ),
    }
    if found.weights is None:
        reason = "learned weights do not predict left-out pixels better, by more than chance"
        if not report["tried"]:
            reason = "the residuals show nothing that all views have in common"
        return solved, report | {"reason": reason}
    whole = sample if len(kept) == len(built.measured) else _with_midpoints(solved, options)
    by_lengths = replace(built, system=whole, choice=choice)
    learned = replace(whole, projector=found.weights.projector(whole.projector))
    last = solve_by(
        method_named(AUTO), None, replace(by_lengths, system=learned), options, watch, progress
    )
    before = solved.solution
    solution = replace(
        last,
        weights=found.weights,
        encoder=found.weights.encoder,
        settings={
            **last.settings,
            "tried": before.settings["tried"],
            "held_out_residual": report["left_out_residual"],
        },
        seconds={**last.seconds, **before.seconds},
    )
    reason = "learned weights predict left-out pixels better, by more than chance"
    return replace(solved, solution=solution, built=by_lengths), report | {
        "taken": True,
        "reason": reason,
    }


def _pixels_that_fit(system: LinearSystem) -> NDArray[np.int64]:
    """Return the pixels to learn from: all, or some blocks of those of a large system."""
    block = blocks_of(system)
    order = golden_ratio_sequence(int(block.max()) + 1)
    return np.flatnonzero(order[block] < SEGMENTS / system.projector.n_segments)


def _with_midpoints(
    solved: Solved, options: Options, kept: NDArray[np.int64] | None = None
) -> LinearSystem:
    """Return the equations of all or some pixels with midpoints, in the basis of the solve."""
    built, system = solved.built, solved.built.system
    flat = np.zeros(len(built.measured), np.float32)
    flat[slice(None) if kept is None else kept] = 1
    traced = LinearSystem.from_rig(
        system.rig,
        system.projector.grid,
        masks=[image > 0 for image in system.images(flat)],
        active=system.projector.active,
        skip=False,
        midpoints=True,
        tracer=options.tracer,
        **options.rays,
        form=STORED,
    )
    traced = through_gas(traced, built.absorption, solved.solution.volume, options)
    linear = built.basis.name == LINEAR
    return traced.with_linear_basis(options.supersample) if linear else traced


def _of_weights(report: dict[str, Any]) -> str:
    """Return the line on what was learned."""
    words = " and ".join(_WORDS[name] for name in report["found"])
    lengths, learned = report["left_out_residual"].values()
    return (
        f"{words}: learned from the images and corrected, since left-out pixels are predicted "
        f"better (relative residual {lengths:.4f} by segment lengths, {learned:.4f} by learned "
        "weights). If the optics are known to be right, reconstruct with --no-learn"
    )
